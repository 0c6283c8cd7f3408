"""VTK on the scene of benchmarks/tablet.py: a process in a virtual environment of its own, which knows nothing of Handrail.

    python tablet_peer.py SCENE.npz

SCENE.npz has the meshes `vertices_I`, `colors_I`, `faces_I` and, for those that move, `poses_I` (k, 4, 4); `ghost` lists the
see-through ones; `points` (n, 3) with `points_colors` uint8 (n, 3) are the cloud.
Speaks JSON lines: {"seconds": 3} → frames a second while the camera goes round and all bodies move.
"""

import json
import sys
import time

import numpy as np
import pyvista
import vtk


def main() -> None:
    scene = np.load(sys.argv[1])
    window = pyvista.Plotter(off_screen=True, window_size=(1280, 800), lighting="none")
    for angle in (30, 120):
        light = pyvista.Light(light_type="scene light")
        light.set_direction_angle(angle, angle)
        window.add_light(light)
    ghost, moving = set(scene["ghost"].tolist()), []
    for number in range(int(scene["count"])):
        faces = scene[f"faces_{number}"]
        if not len(faces):
            continue
        mesh = pyvista.PolyData.from_regular_faces(scene[f"vertices_{number}"], faces)
        mesh["colors"] = (255 * scene[f"colors_{number}"][:, :3]).astype(np.uint8)
        if number in ghost:
            actor = window.add_mesh(mesh, color="#5ab8ff", opacity=0.42, smooth_shading=True)
        else:
            actor = window.add_mesh(mesh, scalars="colors", rgb=True, smooth_shading=True)
        if f"poses_{number}" in scene:
            moving.append((actor, scene[f"poses_{number}"]))
    cloud = pyvista.PolyData(scene["points"])
    cloud["colors"] = scene["points_colors"]
    window.add_mesh(cloud, scalars="colors", rgb=True, style="points", point_size=3, lighting=False)
    window.camera_position = [(1.8, -1.6, 0.8), (0.24, -0.12, 0.1), (0, 0, 1)]
    window.show(auto_close=False, interactive=False)
    matrix = vtk.vtkMatrix4x4()
    for line in sys.stdin:
        seconds, frames, began = json.loads(line)["seconds"], 0, time.monotonic()
        while time.monotonic() - began < seconds:
            for actor, poses in moving:
                matrix = vtk.vtkMatrix4x4()
                matrix.DeepCopy(poses[frames % len(poses)].ravel().tolist())
                actor.SetUserMatrix(matrix)
            window.camera.azimuth += 2
            window.render()
            frames += 1
        print(json.dumps(frames / (time.monotonic() - began)), flush=True)


if __name__ == "__main__":
    main()
