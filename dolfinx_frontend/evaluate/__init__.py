"""Points of an assembly -> answers and numbers: the only place that asks for more than one solve."""
