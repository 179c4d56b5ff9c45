"""`python -m hippomat_host` is `hippomat-host`."""

import sys

from hippomat_host.cli import main

sys.exit(main())
