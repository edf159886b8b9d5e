"""The sizes of tests: small for people, and full with IBDATA_TESTS=full, as in .ci/run."""

import os

FULL = os.environ.get("IBDATA_TESTS") == "full"
EXAMPLES = 1 if FULL else 6  # of hypothesis, one of so many is tried
