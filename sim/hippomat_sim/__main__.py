"""python -m hippomat_sim"""

import sys

from hippomat_sim.cli import main

sys.exit(main())
