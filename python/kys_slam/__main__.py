# SPDX-License-Identifier: BSD-3-Clause
import sys

from kys_slam.cli import main

sys.exit(main())
