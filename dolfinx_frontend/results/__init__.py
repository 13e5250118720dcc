"""What an answer gives: readings of interfaces, resultants, tables."""
