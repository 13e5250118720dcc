"""Formats of files, which know nothing of answers: HDF5 trees, chaos files, VTK grids, meshes."""
