"""Pictures of parts, interfaces and results."""
