"""This package regenerates 6DroneSyn (paper Sec. IV): its drones, scenes, renderer and format on disk.

`dronekeypp.data` opens what `generate` writes as a torch data set.
"""

import contextlib
import os
import sys

if sys.platform == "linux":
    # Off-screen rendering without an X server; must be set before VTK is imported.
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    # Mesa's software renderer and Triton, which torchvision brings in, each hold an LLVM. Importing Triton
    # after the first picture crashes the process; the other way round both work.
    with contextlib.suppress(ImportError):
        import triton  # noqa: F401
