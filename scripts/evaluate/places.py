"""Where things are in the repository."""

import os

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PICTURES = os.path.join(ROOT, "assets", "pictures")
SEQUENCE = os.path.join(ROOT, "assets", "sequence")
BELIEF = os.path.join(ROOT, "core", "src", "detect", "belief.rs")
DOCS = os.path.join(ROOT, "docs")
INSTRUCTIONS = os.path.join(ROOT, "benches", "instructions.json")
RECORDS = os.path.join(ROOT, "benches", "record")
# Cargo's folder of release builds.
RELEASE = os.path.join(ROOT, os.environ.get("CARGO_TARGET_DIR", "target"), "release")
KEYGRAPH = os.path.join(RELEASE, "keygraph")
