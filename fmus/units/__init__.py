"""The units: one file each."""
