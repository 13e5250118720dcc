"""Formats of files, which know nothing of answers: trees in HDF5, chaos files, grids of VTK, meshes as arrays."""
