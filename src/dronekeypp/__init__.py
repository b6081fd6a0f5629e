"""DroneKey++, the course: the 6-DoF pose of a drone from one crop and a camera matrix.

Nobody tells the network the drone's size. The modules follow the paper: `camera`, `rotations` and `pnp` are
its geometry, `sixdronesyn` is the data set (Sec. IV), `model` is the network (Sec. III), and `train` and
`evaluate` are its experiments (Sec. V).
"""

__version__ = "0.2.0"
