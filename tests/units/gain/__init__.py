"""A kind of unit of the tests: its record and its kernels."""
