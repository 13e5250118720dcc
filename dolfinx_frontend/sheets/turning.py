"""A view of the deformed assembly that turns: data and a page of JavaScript inside of the sheet, no network.

Triangles are sorted by their depth and painted, far ones first: no library, and any browser has it.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from dolfinx_frontend.assembly.matrix_part import has_mesh
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.figures.canvas import round_down
from dolfinx_frontend.figures.solids import Skin, skin_of

__all__ = ["Turning", "turning", "view_of"]

MOST = 60_000
"""Triangles that a browser sorts and paints while the mouse moves."""
MOVED = 0.06
"""What the largest displacement is shown as, in sizes of the assembly."""
STEPS = 32767
"""Coordinates are whole numbers of 16 bits."""


class Turning(NamedTuple):
    """Triangles: corners (n, 3, 3) and how far these move, between -1 and 1, and colours (n, 3), 0 to 255."""

    corners: Array
    moves: Array
    colours: Array
    scale: float
    largest: float


def turning(skins: Sequence[Skin]) -> Turning | str:
    """The triangles of skins whose values are displacements; a text: why there are none."""
    from matplotlib import colormaps

    count = sum(len(s.triangles) for s in skins)
    if count > MOST:
        return f"{count} triangles are too many to turn in a browser (more than {MOST})"
    x = np.concatenate([s.points[s.triangles] for s in skins])
    u = np.concatenate([np.asarray(s.values)[s.triangles] for s in skins])
    centre, moved = 0.5 * (x.min(axis=(0, 1)) + x.max(axis=(0, 1))), np.linalg.norm(u, axis=2)
    size, largest = float(np.ptp(x.reshape(-1, 3), axis=0).max()), float(moved.max())
    scale = round_down(MOVED * size / largest) if largest > 0.0 else 1.0
    room = 0.5 * float(np.linalg.norm(np.ptp(x.reshape(-1, 3), axis=0))) + scale * largest
    shares = moved.mean(axis=1) / largest if largest > 0.0 else np.zeros(len(x))
    colours = np.round(255.0 * np.asarray(colormaps["viridis"](shares))[:, :3])
    return Turning((x - centre) / room, scale * u / room, colours, scale, largest)


def view_of(answer: Any, unit: str) -> str:
    """HTML of the last state of an answer; a text that begins without ``<``: why there is no view."""
    parts = [name for name, part in answer.problem.substructures.items() if has_mesh(part)]
    functions = [answer.displacement(name) for name in parts]
    if not functions or functions[0].function_space.mesh.geometry.dim != 3:
        return "only solids turn"
    found = turning([skin_of(u.function_space.mesh, None, u)[0] for u in functions])
    if isinstance(found, str):
        return found

    def packed(values: Array, kind: str) -> str:
        return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()

    largest = f"{found.largest:.4g} {unit}".rstrip()
    return (
        "<figure class='turns'><canvas id='view' width='1000' height='680'"
        f" data-p='{packed(np.round(STEPS * found.corners), '<i2')}'"
        f" data-u='{packed(np.round(STEPS * found.moves), '<i2')}' data-c='{packed(found.colours, 'u1')}'>"
        "</canvas><br><label>displacements <input id='view-scale' type='range' min='0' max='100' value='100'>"
        f" up to × {found.scale:g}</label><figcaption>the assembly, coloured by |u| from 0 to "
        f"{escape(largest)}: drag to turn, wheel to zoom</figcaption></figure><script>{_SCRIPT}</script>"
    )


_SCRIPT = """
(()=>{
const c=document.getElementById("view"),s=document.getElementById("view-scale"),g=c.getContext("2d");
const of=(t,K)=>{const b=atob(t),a=new Uint8Array(b.length);
for(let i=0;i<b.length;i++)a[i]=b.charCodeAt(i);return new K(a.buffer)};
const P=of(c.dataset.p,Int16Array),U=of(c.dataset.u,Int16Array),C=of(c.dataset.c,Uint8Array),n=C.length/3;
const X=new Float32Array(3*n),Y=new Float32Array(3*n),D=new Float32Array(3*n),F=new Float32Array(n);
const order=new Uint32Array(n);for(let t=0;t<n;t++)order[t]=t;
let yaw=-0.6,pitch=0.5,zoom=1.3,waits=false;
function draw(){
waits=false;
const w=c.width,h=c.height,r=0.5*Math.min(w,h)*zoom/32767,m=s.value/100;
const ca=Math.cos(yaw),sa=Math.sin(yaw),ce=Math.cos(pitch),se=Math.sin(pitch);
for(let k=0;k<3*n;k++){
const x=P[3*k]+m*U[3*k],y=P[3*k+1]+m*U[3*k+1],z=P[3*k+2]+m*U[3*k+2];
const a=ca*x+sa*y,b=ca*y-sa*x;
X[k]=w/2+r*a;Y[k]=h/2-r*(ce*z+se*b);D[k]=r*(ce*b-se*z);}
for(let t=0;t<n;t++)F[t]=D[3*t]+D[3*t+1]+D[3*t+2];
order.sort((p,q)=>F[q]-F[p]);
g.fillStyle="#fff";g.fillRect(0,0,w,h);g.lineWidth=0.6;
for(const t of order){
const i=3*t,ax=X[i+1]-X[i],ay=Y[i+1]-Y[i],ad=D[i+1]-D[i],bx=X[i+2]-X[i],by=Y[i+2]-Y[i],bd=D[i+2]-D[i];
const nx=ay*bd-ad*by,ny=ad*bx-ax*bd,nz=ax*by-ay*bx,q=Math.hypot(nx,ny,nz)||1;
const l=0.5+0.5*Math.abs(nz)/q;
g.fillStyle=g.strokeStyle="rgb("+Math.round(l*C[i])+","+Math.round(l*C[i+1])+","+Math.round(l*C[i+2])+")";
g.beginPath();g.moveTo(X[i],Y[i]);g.lineTo(X[i+1],Y[i+1]);g.lineTo(X[i+2],Y[i+2]);g.closePath();
g.fill();g.stroke();}}
const ask=()=>{if(!waits){waits=true;requestAnimationFrame(draw)}};
let from=null;
c.addEventListener("pointerdown",e=>{from=[e.clientX,e.clientY,yaw,pitch];c.setPointerCapture(e.pointerId)});
c.addEventListener("pointermove",e=>{if(!from)return;yaw=from[2]+(e.clientX-from[0])/150;
pitch=Math.max(-1.57,Math.min(1.57,from[3]+(e.clientY-from[1])/150));ask()});
c.addEventListener("pointerup",()=>{from=null});
c.addEventListener("wheel",e=>{e.preventDefault();zoom*=Math.exp(-e.deltaY/600);ask()},{passive:false});
s.addEventListener("input",ask);
draw();
})();
"""
