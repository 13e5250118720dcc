"""Questions to an assembly: rare events, measured data, which inputs matter."""
