"""Finds planar objects (books, posters, boxes, signs) in camera frames, from one picture of each.

>>> import keygraph
>>> model = keygraph.train("cover.jpg")
>>> detector = keygraph.Detector(model)
>>> for found in detector.detect("photo.jpg"):
...     print(found.object, found.score, found.corners)

Coordinates are px of the frame, x to the right and y down; (0, 0) is the centre of the top left pixel.
"""

from keygraph._detections import Detections
from keygraph._keygraph import (
    Assessment,
    Detection,
    Detector,
    Model,
    ModelFileError,
    ModelObject,
    Pose,
    Tracker,
    TrainingError,
    TrainingWarning,
    __version__,
    assess,
    draw,
    imread,
    imwrite,
    pack,
    pose,
    train,
)

__all__ = [
    "Assessment",
    "Detection",
    "Detections",
    "Detector",
    "Model",
    "ModelFileError",
    "ModelObject",
    "Pose",
    "Tracker",
    "TrainingError",
    "TrainingWarning",
    "__version__",
    "assess",
    "draw",
    "imread",
    "imwrite",
    "pack",
    "pose",
    "train",
]
