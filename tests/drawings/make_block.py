"""Write tests/drawings/block.step with OpenCASCADE (cadquery-ocp-novtk, which the tests do not need)."""

import re
from pathlib import Path

from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCone,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakeSphere,
)
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.IGESControl import IGESControl_Writer
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.TopAbs import TopAbs_EDGE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

UP = gp_Dir(0, 0, 1)


def at(x, y, z):
    return gp_Ax2(gp_Pnt(x, y, z), UP)


def edges(shape):
    found = TopExp_Explorer(shape, TopAbs_EDGE)
    while found.More():
        yield (
            TopoDS.Edge_s(found.Current())
            if hasattr(TopoDS, "Edge_s")
            else TopoDS.Edge(found.Current())
        )
        found.Next()


def middle(edge):
    from OCP.BRepAdaptor import BRepAdaptor_Curve

    curve = BRepAdaptor_Curve(edge)
    p = curve.Value(0.5 * (curve.FirstParameter() + curve.LastParameter()))
    return p.X(), p.Y(), p.Z(), curve.Value(curve.FirstParameter()).Z()


def block():
    """80 × 60 × 20 mm with a conical boss, a spherical pocket, and a bore with a round edge."""
    shape = BRepPrimAPI_MakeBox(80.0, 60.0, 20.0).Shape()
    shape = BRepAlgoAPI_Fuse(shape, BRepPrimAPI_MakeCone(at(20, 40, 20), 12, 8, 15).Shape()).Shape()
    shape = BRepAlgoAPI_Cut(shape, BRepPrimAPI_MakeSphere(gp_Pnt(60, 18, 30), 18).Shape()).Shape()
    shape = BRepAlgoAPI_Cut(shape, BRepPrimAPI_MakeCylinder(at(58, 46, -1), 6, 30).Shape()).Shape()
    round_ = BRepFilletAPI_MakeFillet(shape)
    done = set()
    for edge in edges(shape):
        x, y, z, z0 = middle(edge)
        upright = abs(x) < 1e-6 and abs(y) < 1e-6 and abs(z - 10) < 1e-6
        rim = abs((x - 58) ** 2 + (y - 46) ** 2 - 36) < 1e-3 and abs(z - 20) < 1e-6 and z0 == z
        kind = "upright" if upright else "rim" if rim else ""
        if kind and kind not in done:
            round_.Add(8.0 if upright else 3.0, edge)
            done.add(kind)
    assert done == {"upright", "rim"}, done
    return round_.Shape()


if __name__ == "__main__":
    folder = Path(__file__).parent
    shape = block()
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_AsIs)
    writer.Write(str(folder / "block.step"))
    text = (folder / "block.step").read_text()
    count = iter(range(1, 100))
    text = re.sub(r"ADVANCED_FACE\(''", lambda _: f"ADVANCED_FACE('F{next(count)}'", text)
    text = re.sub(r"'\d{4}-\d\d-\d\dT[\d:]+'", "'2026-01-01T00:00:00'", text)
    (folder / "block.step").write_text(text)
    iges = IGESControl_Writer("MM", 1)
    iges.AddShape(shape)
    iges.ComputeModel()
    iges.Write(str(folder / "block.igs"))
