"""Interface laws of a scene: frozen records, a file each.

Notation, for all laws: n is the unit normal out of side 1; f_i the force per area that the
interface exerts on side i; w_i the displacement of side i; j = w_2 - w_1 the jump.  One-sided
interfaces have the ground as side 2, so that j = -w_1.  The frame of a point is (n, t1[, t2]).
Units are the user's own consistent set, e.g. N and mm; then stiffness per area is N/mm^3.
"""

from dolfinx_frontend.scene.laws.base import Elimination, Fields, Functions, Law, Points, resolve
from dolfinx_frontend.scene.laws.contact import Contact
from dolfinx_frontend.scene.laws.debonding import Debonding
from dolfinx_frontend.scene.laws.displacement import Displacement
from dolfinx_frontend.scene.laws.elastic import Elastic
from dolfinx_frontend.scene.laws.held import Held
from dolfinx_frontend.scene.laws.linked import Linked
from dolfinx_frontend.scene.laws.perfect import Perfect
from dolfinx_frontend.scene.laws.preload import Preload
from dolfinx_frontend.scene.laws.pressure import Pressure
from dolfinx_frontend.scene.laws.rigid import MOTIONS, Rigid
from dolfinx_frontend.scene.laws.symmetry import Symmetry
from dolfinx_frontend.scene.laws.traction import Traction
from dolfinx_frontend.scene.laws.user import UserLaw

__all__ = [
    "Contact",
    "Debonding",
    "Displacement",
    "Elastic",
    "Elimination",
    "Fields",
    "Functions",
    "Held",
    "Law",
    "Linked",
    "MOTIONS",
    "Perfect",
    "Points",
    "Preload",
    "Pressure",
    "Rigid",
    "Symmetry",
    "Traction",
    "UserLaw",
    "resolve",
]
