"""The Python packages that the commands need."""

import importlib.util
import os
import subprocess
import sys

from places import ROOT

# Module -> package.
PACKAGES = {
    "cv2": "opencv-python-headless",
    "numpy": "numpy",
    "matplotlib": "matplotlib",
    "sklearn": "scikit-learn",
}
FOLDER = os.path.join(ROOT, "out", "evaluate")


def need(modules):
    """Starts the program anew with the packages of `modules` where one is missing.

    They are installed into a virtual environment, out/evaluate, which later runs use again.
    """
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if not missing:
        return
    if os.path.realpath(sys.prefix) == os.path.realpath(FOLDER):
        install(missing)  # An earlier run needed fewer.
        return
    python = os.path.join(FOLDER, "bin", "python3")
    if not os.path.exists(python):
        print(f"{', '.join(missing)} missing: a virtual environment is made in {FOLDER}", file=sys.stderr)
        run([sys.executable, "-m", "venv", FOLDER], missing)
    os.execv(python, [python, *sys.argv])


def missing_for_tests(modules):
    """Whether tests must be skipped for lack of `modules`. Says so; with KEYGRAPH_MUST_NOT_SKIP it is an error."""
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if missing and os.environ.get("KEYGRAPH_MUST_NOT_SKIP"):
        raise ImportError(f"{', '.join(missing)} missing, and nothing may be skipped")
    if missing:
        packages = " ".join(PACKAGES[module] for module in missing)
        print(f"SKIPPED: {', '.join(missing)} missing; install with: pip install {packages}", file=sys.stderr)
    return bool(missing)


def install(modules):
    """Installs the packages of `modules` into the environment that runs."""
    packages = [PACKAGES[module] for module in modules]
    run([sys.executable, "-m", "pip", "install", "--quiet", *packages], modules)
    importlib.invalidate_caches()


def run(command, modules):
    """Runs a command; where it fails, ends the program and says what to install."""
    if subprocess.run(command, check=False).returncode:
        sys.exit(f"install what is missing: pip install {' '.join(PACKAGES[module] for module in modules)}")
