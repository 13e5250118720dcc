"""Random parameters and fields, the chaos that is requested, its basis, and statistics of quantities."""
