"""Files: saved results, chaos files, fields for ParaView."""

from dolfinx_frontend.common.files import FileError
from dolfinx_frontend.formats.chaos_file import ChaosFile, Field, ParameterMap, load_chaos, save_chaos
from dolfinx_frontend.formats.hdf5 import ChaosFileError
from dolfinx_frontend.formats.openturns import to_openturns
from dolfinx_frontend.io.facets import facet_fields
from dolfinx_frontend.io.paraview import write, write_fields, write_interfaces
from dolfinx_frontend.results.saved import load
from dolfinx_frontend.results.saved import SavedInterface, SavedResult
from dolfinx_frontend.results.writing import ResultFileError

__all__ = [
    "ChaosFile",
    "ChaosFileError",
    "Field",
    "FileError",
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
