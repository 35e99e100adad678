"""Identification: from measured responses to the physical parameters, and how well the data determine them."""
