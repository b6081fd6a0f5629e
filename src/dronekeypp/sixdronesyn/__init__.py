"""6DroneSyn (paper Sec. IV), regenerated: drones, environments, scenes, renderer, the on-disk format and the torch data set."""

import os
import sys

if sys.platform == "linux":
    # Off-screen rendering without an X server; must be set before VTK is imported.
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
