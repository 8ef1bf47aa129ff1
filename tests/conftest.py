"""What all tests share: reproducible hypothesis runs, English texts, one thread per worker."""

import os

os.environ["LANGUAGE"] = "en"  # read by gettext when ctlabs.text is imported
for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"  # read when numpy loads

from hypothesis import settings  # noqa: E402  # after the environment is set

# Derandomised: the same examples on every machine; the seeds of a failing run are those of the next one.
settings.register_profile("ctlabs", deadline=None, derandomize=True, max_examples=50, print_blob=True)
settings.load_profile("ctlabs")
