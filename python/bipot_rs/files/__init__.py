"""File formats: HDF5, VTK and CSV. Nothing here knows mechanics."""
