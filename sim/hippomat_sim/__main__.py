"""python -m hippomat_sim"""

import sys

from hippomat_sim.entry import main

sys.exit(main())
