"""What will be solved, and why: laws as fields, reduced parts, coarse spaces, cost and method."""
