"""``python -m bipot_rs`` is the command `bipot`."""

import sys

from bipot_rs.cli.app import app

sys.exit(app())
