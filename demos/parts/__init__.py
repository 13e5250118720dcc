"""What demos, tests and benchmarks share and the library does not need: example parts, and figures."""
