"""Used by all other sub-packages: errors, texts, progress, differences between releases of dolfinx."""
