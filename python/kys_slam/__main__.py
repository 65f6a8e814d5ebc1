import sys

from kys_slam.cli import main

sys.exit(main())
