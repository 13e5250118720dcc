"""What becomes of the keywords of a deck: represented, ignored or refused; elements are in `elements`."""

from __future__ import annotations

import difflib

__all__ = ["ACTING", "IGNORED", "REFUSED", "REPRESENTED", "fate"]

_LOAD = "OP AMPLITUDE"
REPRESENTED = {
    "NODE": "NSET SYSTEM INPUT", "ELEMENT": "TYPE ELSET INPUT", "NGEN": "NSET LINE",
    "NFILL": "NSET BIAS SINGULAR", "ELGEN": "ELSET", "SYSTEM": "",
    "NSET": "NSET GENERATE INSTANCE ELSET INPUT UNSORTED INTERNAL",
    "ELSET": "ELSET GENERATE INSTANCE INPUT UNSORTED INTERNAL",
    "SURFACE": "NAME TYPE INTERNAL", "PART": "NAME", "END PART": "", "INSTANCE": "NAME PART",
    "END INSTANCE": "", "ASSEMBLY": "NAME", "END ASSEMBLY": "",
    "MATERIAL": "NAME", "ELASTIC": "TYPE", "EXPANSION": "TYPE ZERO", "DENSITY": "",
    "ORIENTATION": "NAME SYSTEM", "SOLID SECTION": "ELSET MATERIAL ORIENTATION CONTROLS",
    "TRANSFORM": "NSET TYPE", "AMPLITUDE": "NAME TIME DEFINITION VALUE INPUT",
    "SURFACE INTERACTION": "NAME", "SURFACE BEHAVIOR": "PRESSURE-OVERCLOSURE", "FRICTION": "ROUGH",
    "CONTACT PAIR": "INTERACTION TYPE ADJUST SMALLSLIDING", "CLEARANCE": "MASTER SLAVE VALUE",
    "TIE": "NAME POSITIONTOLERANCE ADJUST CYCLICSYMMETRY MULTISTAGE TYPE",
    "PRE-TENSION SECTION": "SURFACE NODE ELEMENT",
    "RIGID BODY": "NSET PINNSET TIENSET ELSET REFNODE ROTNODE",
    "COUPLING": "REFNODE SURFACE CONSTRAINTNAME ORIENTATION", "KINEMATIC": "", "DISTRIBUTING": "",
    "KINEMATIC COUPLING": "REFNODE ORIENTATION", "DISTRIBUTING COUPLING": "ELSET",
    "EQUATION": "", "SPRING": "ELSET NONLINEAR ORIENTATION", "CHANGE FRICTION": "INTERACTION",
    "INITIAL CONDITIONS": "TYPE", "STEP": "NAME INC NLGEOM PERTURBATION AMPLITUDE", "END STEP": "",
    "STATIC": "DIRECT SOLVER", "BOUNDARY": "OP AMPLITUDE FIXED",
    "CLOAD": f"{_LOAD} FOLLOWER", "DLOAD": _LOAD, "DSLOAD": f"{_LOAD} FOLLOWER CONSTANTRESULTANT",
    "TEMPERATURE": _LOAD,
}
"""Keyword -> its parameters, without blanks; others are ignored, or refused where they change what acts."""

ACTING = frozenset(
    "BOUNDARY CLOAD DLOAD DSLOAD TEMPERATURE EQUATION KINEMATIC DISTRIBUTING AMPLITUDE".split()
) | {"INITIAL CONDITIONS", "DISTRIBUTING COUPLING", "KINEMATIC COUPLING"}
"""Keywords of which every parameter matters."""

IGNORED = {
    "HEADING": "", "PREPRINT": "", "CONTROLS": "", "RESTART": "", "TIME POINTS": "", "MONITOR": "",
    "PHYSICAL CONSTANTS": "", "FILE FORMAT": "", "SOLID SECTION CONTROLS": "", "SECTION CONTROLS": "",
    "DAMPING": "nothing moves fast",
}
"""Keyword -> why, if that is not plain; so are all that end in PRINT, FILE or OUTPUT."""

REFUSED = {
    "CYCLIC SYMMETRY MODEL": "cut symmetry has no interface here; model a sector between symmetry planes",
    "FREQUENCY": "no vibrations", "BUCKLE": "no stability", "COMPLEX FREQUENCY": "no vibrations",
    "MODEL CHANGE": "nothing comes or goes between steps", "MPC": "no constraints by name",
    "DYNAMIC": "no dynamics", "MODAL DYNAMIC": "no dynamics", "STEADY STATE DYNAMICS": "no dynamics",
    "FLUID": "no fluids", "FLUID CONSTANTS": "no fluids", "FLUID SECTION": "no fluids", "CFD": "no fluids",
    "SENSITIVITY": "use problem.function for gradients", "DESIGN VARIABLES": "no design variables",
    "DESIGN RESPONSE": "no design variables", "OBJECTIVE": "no design variables",
    "PLASTIC": "parts are linear elastic", "CYCLIC HARDENING": "parts are linear elastic",
    "CREEP": "parts are linear elastic", "VISCO": "parts are linear elastic",
    "HYPERELASTIC": "parts are linear elastic", "HYPERFOAM": "parts are linear elastic",
    "DEFORMATION PLASTICITY": "parts are linear elastic", "USER MATERIAL": "no materials by user",
    "DEPVAR": "no materials by user", "GAP CONDUCTANCE": "no heat transfer",
    "HEAT TRANSFER": "no heat transfer", "GAP HEAT GENERATION": "no heat transfer",
    "COUPLED TEMPERATURE-DISPLACEMENT": "no heat transfer", "CONDUCTIVITY": "no heat transfer",
    "UNCOUPLED TEMPERATURE-DISPLACEMENT": "no heat transfer", "SPECIFIC HEAT": "no heat transfer",
    "CFLUX": "no heat transfer", "DFLUX": "no heat transfer", "FILM": "no heat transfer",
    "RADIATE": "no heat transfer", "SUBMODEL": "no submodels", "GREEN": "no Green functions",
    "REFINE MESH": "use solve(scene, accuracy=...)", "SUBSTRUCTURE GENERATE": "no condensed parts",
    "SHELL SECTION": "solids only", "BEAM SECTION": "solids only", "BEAM GENERAL SECTION": "solids only",
    "MEMBRANE SECTION": "solids only", "DASHPOT": "no dynamics",
    **dict.fromkeys(("GAP", "ADJUST", "MASS", "CHANGE SURFACE BEHAVIOR"), "it is not read yet"),
    "CONTACT": "general contact finds its own pairs; write them, *CONTACT PAIR",
    "INCLUDE": "it has no INPUT=",
}
"""Keyword -> why it is refused."""


def fate(keyword: str) -> tuple[str, str]:
    """"represented", "ignored" or "refused", and why."""
    if keyword in REPRESENTED:
        return "represented", ""
    if keyword in IGNORED or keyword.endswith(("PRINT", "FILE", "OUTPUT")):
        return "ignored", IGNORED.get(keyword) or "output is asked of the result"
    if keyword in REFUSED:
        return "refused", REFUSED[keyword]
    near = difflib.get_close_matches(keyword, sorted(REPRESENTED), n=1, cutoff=0.75)
    return "refused", f"unknown keyword; did you mean *{near[0]}?" if near else "unknown keyword"
