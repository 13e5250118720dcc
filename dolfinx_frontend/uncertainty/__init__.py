"""Random parameters and fields, the chaos that is asked for, its space, and quantities of it."""
