"""Questions to an assembly as a function: its values and derivatives, rare events, measured data."""
