import os

# Two busy processes with spinning OpenMP threads stall each other; sleeping ones do not. Must be set before a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
