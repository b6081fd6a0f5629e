"""DroneKey++, the course: 6-DoF drone pose from one crop and a camera matrix, without being told the drone's size.

The rooms follow the paper: `camera`, `rotations`, `pnp` (geometry), `sixdronesyn` (Sec. IV, the data set), `model` (Sec. III, the network),
`train` and `evaluate` (Sec. V).
"""

__version__ = "0.1.0"
