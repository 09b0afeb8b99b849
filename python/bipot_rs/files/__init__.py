"""File formats: HDF5, VTK and CSV, without any mechanics."""
