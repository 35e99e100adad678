"""The FMI 2.0 units: interfaces, kernels, packaging."""
