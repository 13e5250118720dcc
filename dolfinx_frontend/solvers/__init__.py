"""How an answer is found: one solve, chaos, samples, sweeps."""
