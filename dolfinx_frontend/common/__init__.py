"""What everything uses: errors, texts, progress, differences between releases of dolfinx."""
