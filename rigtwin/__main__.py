"""`python -m rigtwin` is the command line."""

import sys

from rigtwin.cli import main

sys.exit(main())
