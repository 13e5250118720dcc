"""Files: saved results, chaos files, fields for ParaView."""

from dolfinx_frontend.io.chaos_file import ChaosFile, Field, ParameterMap, load_chaos, save_chaos
from dolfinx_frontend.io.facets import facet_fields
from dolfinx_frontend.io.hdf5 import ChaosFileError
from dolfinx_frontend.io.openturns import to_openturns
from dolfinx_frontend.io.paraview import write, write_fields, write_interfaces
from dolfinx_frontend.io.saved import ResultFileError, SavedInterface, SavedResult, load

__all__ = [
    "ChaosFile",
    "ChaosFileError",
    "Field",
    "ParameterMap",
    "ResultFileError",
    "SavedInterface",
    "SavedResult",
    "facet_fields",
    "load",
    "load_chaos",
    "save_chaos",
    "to_openturns",
    "write",
    "write_fields",
    "write_interfaces",
]
