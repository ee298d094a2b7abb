"""``python -m firmware_py`` is ``orbitd``."""

import sys

from firmware_py.cli import main

sys.exit(main())
