"""What becomes of the keywords of a deck: represented, ignored or refused; elements are in `elements`."""

from __future__ import annotations

import difflib

__all__ = ["ACTING", "IGNORED", "REFUSED", "REPRESENTED", "fate"]

_LOAD = "OP AMPLITUDE TIMEDELAY"
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
    "EQUATION": "", "SPRING": "ELSET NONLINEAR ORIENTATION", "GAP": "ELSET", "CHANGE FRICTION": "INTERACTION",
    "INITIAL CONDITIONS": "TYPE", "STEP": "NAME INC NLGEOM PERTURBATION AMPLITUDE", "END STEP": "",
    "STATIC": "DIRECT SOLVER", "BOUNDARY": f"{_LOAD} FIXED",
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
    "DAMPING": "nothing moves fast", "BEAM SECTION": "rods have the force of their pre-tension section",
}
"""Keyword -> why, if that is not plain; so are all that end in PRINT, FILE or OUTPUT."""

_WHY = {
    "cut symmetry has no interface here; model a sector between symmetry planes": "CYCLIC SYMMETRY MODEL",
    "no vibrations": "FREQUENCY; COMPLEX FREQUENCY",
    "no stability": "BUCKLE",
    "nothing comes or goes between steps": "MODEL CHANGE",
    "no constraints by name": "MPC",
    "no dynamics": "DYNAMIC; MODAL DYNAMIC; STEADY STATE DYNAMICS; DASHPOT",
    "no fluids": "FLUID; FLUID CONSTANTS; FLUID SECTION; CFD",
    "use problem.function for gradients": "SENSITIVITY",
    "no design variables": "DESIGN VARIABLES; DESIGN RESPONSE; OBJECTIVE",
    "parts are linear elastic": (
        "PLASTIC; CYCLIC HARDENING; CREEP; VISCO; HYPERELASTIC; HYPERFOAM; DEFORMATION PLASTICITY"
    ),
    "no materials by user": "USER MATERIAL; DEPVAR",
    "no heat transfer": (
        "GAP CONDUCTANCE; HEAT TRANSFER; GAP HEAT GENERATION; COUPLED TEMPERATURE-DISPLACEMENT; "
        "CONDUCTIVITY; UNCOUPLED TEMPERATURE-DISPLACEMENT; SPECIFIC HEAT; CFLUX; DFLUX; FILM; RADIATE"
    ),
    "no submodels": "SUBMODEL",
    "no Green functions": "GREEN",
    "use solve(scene, accuracy=...)": "REFINE MESH",
    "no condensed parts": "SUBSTRUCTURE GENERATE",
    "solids only": "SHELL SECTION; BEAM GENERAL SECTION; MEMBRANE SECTION",
    "it is not read yet": "ADJUST; MASS",
    "an interface has one law in all steps": "CHANGE SURFACE BEHAVIOR; CHANGE CONTACT TYPE",
    "a part has one material in all steps": "CHANGE SOLID SECTION; CHANGE MATERIAL",
    "general contact finds its own pairs; write them, *CONTACT PAIR": "CONTACT",
    "it has no INPUT=": "INCLUDE",
}
REFUSED = {keyword: why for why, keywords in _WHY.items() for keyword in keywords.split("; ")}
"""Keyword -> why it is refused."""


def fate(keyword: str) -> tuple[str, str]:
    """"represented", "ignored" or "refused", and why."""
    if keyword in REPRESENTED:
        return "represented", ""
    if keyword in IGNORED or keyword.endswith(("PRINT", "FILE", "OUTPUT")):
        return "ignored", IGNORED.get(keyword, "output is asked of the result")
    if keyword in REFUSED:
        return "refused", REFUSED[keyword]
    near = difflib.get_close_matches(keyword, sorted(REPRESENTED), n=1, cutoff=0.75)
    return "refused", f"unknown keyword; did you mean *{near[0]}?" if near else "unknown keyword"
