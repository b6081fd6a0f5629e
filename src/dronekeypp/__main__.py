"""`python -m dronekeypp`."""

import sys

from dronekeypp.cli import main

sys.exit(main())
