"""Name the colours that figures and overlays share: Okabe–Ito, which colour-blind readers can tell apart."""

# One for each keypoint: front-left, front-right, rear-right, rear-left.
KEYPOINT_COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#56B4E9")
AXIS_COLOURS = ("#D55E00", "#009E73", "#0072B2")  # body x (forward), y (left), z (up)
