"""Reads meshes with trimesh and meshio: one line of JSON for each path given.

A line has what each of the two libraries says of the file: vertices, faces, bounds, and by trimesh
also whether the mesh is watertight, its volume and the colour of the first vertex.
"""

import json
import sys

import meshio
import trimesh


def by_trimesh(path):
    mesh = trimesh.load(path, force="mesh")
    colors = getattr(mesh.visual, "vertex_colors", None)
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "bounds": mesh.bounds.tolist(),
        "watertight": bool(mesh.is_watertight),
        "winding": bool(mesh.is_winding_consistent),
        "volume": float(mesh.volume),
        "color": None if colors is None else [int(part) for part in colors[0]],
        "face_colors": face_colors(path),
    }


def face_colors(path):
    """The colour of each face whose three vertices have the same, else None for the face."""
    # Vertices at the same position stay apart.
    mesh = trimesh.load(path, force="mesh", process=False)
    colors = getattr(mesh.visual, "vertex_colors", None)
    if colors is None:
        return None
    corners = [[tuple(int(part) for part in colors[v]) for v in face] for face in mesh.faces]
    return [face[0] if face[0] == face[1] == face[2] else None for face in corners]


def by_meshio(path):
    mesh = meshio.read(path)
    points = mesh.points[:, :3]
    return {
        "vertices": len(points),
        "faces": sum(len(block.data) for block in mesh.cells if block.type == "triangle"),
        "bounds": [points.min(axis=0).tolist(), points.max(axis=0).tolist()],
    }


for path in sys.argv[1:]:
    line = {"trimesh": by_trimesh(path)}
    # meshio knows no glTF.
    if not path.endswith(".glb"):
        line["meshio"] = by_meshio(path)
    print(json.dumps(line))
