import builtins
from collections.abc import Iterable, Sequence
from os import PathLike
from typing import Any, Literal, Protocol, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from keygraph._detections import Detections

__all__ = [
    "Answer",
    "Assessment",
    "Detection",
    "Detector",
    "Model",
    "ModelFileError",
    "ModelObject",
    "Pose",
    "Tracker",
    "TrainingError",
    "TrainingWarning",
    "__version__",
    "_png",
    "_restore",
    "assess",
    "draw",
    "imread",
    "imwrite",
    "pack",
    "pose",
    "train",
]

__version__: str

class _Image(Protocol):
    """A PIL image, by what is used of it."""

    @property
    def mode(self) -> str: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def info(self) -> dict[Any, Any]: ...
    def tobytes(self) -> bytes: ...
    def convert(self, mode: str, /) -> Any: ...

_Path: TypeAlias = str | PathLike[str]
_Frame: TypeAlias = NDArray[Any] | _Image | _Path | bytes | bytearray | memoryview
_Models: TypeAlias = Model | _Path | Iterable[Model | _Path]
_Preset: TypeAlias = Literal["large", "standard", "compact", "paper"]
_Profile: TypeAlias = Literal["hd", "vga", "qvga", "qqvga"]
_Order: TypeAlias = Literal["rgb", "bgr"] | str
_Format: TypeAlias = Literal["rgb", "gray", "yuyv", "uyvy", "nv12", "i420", "rgb565", "rgb565be"] | str
_Length: TypeAlias = int | str
_Region: TypeAlias = str | tuple[_Length, _Length, _Length, _Length]
_Part: TypeAlias = str | tuple[int, int, int, int]
_Intrinsics: TypeAlias = Sequence[float] | Sequence[Sequence[float]] | NDArray[Any]

class TrainingError(ValueError): ...
class ModelFileError(ValueError): ...
class TrainingWarning(UserWarning): ...

@final
class ModelObject:
    @property
    def name(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...

@final
class Model:
    def __new__(cls, data: builtins.bytes | bytearray) -> Model: ...
    @classmethod
    def load(cls, path: _Path) -> Model: ...
    def save(self, path: _Path) -> None: ...
    def without(self, *names: str) -> Model: ...
    def slim(self) -> Model: ...
    def bytes(self) -> builtins.bytes: ...
    def __bytes__(self) -> builtins.bytes: ...
    @property
    def objects(self) -> tuple[ModelObject, ...]: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def preset(self) -> str | None: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def keypoints(self) -> int: ...
    @property
    def keygraphs(self) -> int: ...
    @property
    def luma_only(self) -> bool: ...
    def __len__(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Detection:
    @property
    def object(self) -> str: ...
    @property
    def index(self) -> int: ...
    @property
    def score(self) -> float: ...
    @property
    def visible(self) -> float: ...
    @property
    def votes(self) -> int: ...
    @property
    def agreeing(self) -> int: ...
    @property
    def corners(self) -> NDArray[np.float32]: ...
    @property
    def homography(self) -> NDArray[np.float64]: ...
    @property
    def xyxy(self) -> NDArray[np.float32]: ...
    @property
    def surface(self) -> NDArray[np.float32] | None: ...
    @property
    def rivals(self) -> list[tuple[str, float]]: ...
    @property
    def id(self) -> int | None: ...
    @property
    def state(self) -> Literal["found", "tracked", "lost"]: ...
    @property
    def unseen(self) -> int: ...
    def to_dict(self) -> dict[str, Any]: ...
    def _repr_html_(self) -> str: ...

@final
class Answer:
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def complete(self) -> bool: ...
    @property
    def searched(self) -> bool | None: ...
    @property
    def source(self) -> str | None: ...
    @property
    def time_ms(self) -> dict[str, float]: ...
    def lost(self) -> list[Detection]: ...
    def line(self, source: str | None, frame: int) -> dict[str, Any]: ...

@final
class Detector:
    def __new__(
        cls,
        models: _Models,
        profile: _Profile | str = "vga",
        threshold: float = 0.8,
        *,
        min_visible: float = 0.0,
        thorough: bool = False,
        wide: bool = False,
        all_names: bool = False,
        budget_ms: float | None = None,
        roi: _Region | None = None,
        mirror: bool = False,
        surface: Literal["any", "plane"] | str = "any",
        intrinsics: _Intrinsics | None = None,
        distortion: Sequence[float] | NDArray[Any] | None = None,
        fisheye: bool = False,
        threads: int = 1,
        digests: bool = False,
    ) -> Detector: ...
    def detect(
        self,
        frame: _Frame,
        *,
        order: _Order = "rgb",
        format: _Format | None = None,
        size: tuple[int, int] | None = None,
        stride: int | None = None,
    ) -> Detections: ...
    @property
    def model(self) -> Model: ...
    @property
    def profile(self) -> str: ...
    @property
    def threshold(self) -> float: ...

@final
class Tracker:
    def __new__(
        cls,
        models: _Models,
        profile: _Profile | str = "vga",
        threshold: float = 0.8,
        *,
        min_visible: float = 0.0,
        thorough: bool = False,
        budget_ms: float | None = None,
        roi: _Region | None = None,
        mirror: bool = False,
        surface: Literal["any", "plane"] | str = "any",
        intrinsics: _Intrinsics | None = None,
        distortion: Sequence[float] | NDArray[Any] | None = None,
        fisheye: bool = False,
        threads: int = 1,
        smooth: int = 0,
    ) -> Tracker: ...
    def track(
        self,
        frame: _Frame,
        *,
        order: _Order = "rgb",
        format: _Format | None = None,
        size: tuple[int, int] | None = None,
        stride: int | None = None,
    ) -> Detections: ...
    def reset(self) -> None: ...
    def search_next(self) -> None: ...
    @property
    def model(self) -> Model: ...
    @property
    def profile(self) -> str: ...
    @property
    def threshold(self) -> float: ...

@final
class Pose:
    @property
    def rotation(self) -> NDArray[np.float64]: ...
    @property
    def translation_mm(self) -> NDArray[np.float64]: ...
    @property
    def error_px(self) -> float: ...
    @property
    def ambiguous(self) -> bool: ...
    @property
    def mirrored(self) -> Pose: ...
    @property
    def axes(self) -> NDArray[np.float32]: ...
    def to_dict(self) -> dict[str, Any]: ...

@final
class Assessment:
    @property
    def object(self) -> str: ...
    @property
    def score(self) -> int: ...
    @property
    def limits(self) -> list[tuple[str, str]]: ...
    @property
    def table(self) -> dict[str, list[tuple[float, float]]]: ...
    @property
    def heat(self) -> NDArray[np.uint8]: ...
    def to_dict(self) -> dict[str, Any]: ...
    def _repr_png_(self) -> bytes: ...

def train(
    image: _Frame,
    name: str | None = None,
    preset: _Preset | str = "large",
    *,
    luma: bool = False,
    max_bytes: int | None = None,
    crop: _Part | None = None,
    order: _Order = "rgb",
    format: _Format | None = None,
    size: tuple[int, int] | None = None,
) -> Model: ...
def pack(models: _Models) -> Model: ...
def imread(path: _Path) -> NDArray[np.uint8]: ...
def imwrite(path: _Path, frame: _Frame, *, order: _Order = "rgb") -> None: ...
def pose(detection: Detection, intrinsics: _Intrinsics, width_mm: float) -> Pose | None: ...
def assess(
    image: _Frame,
    model: Model | None = None,
    *,
    name: str | None = None,
    preset: _Preset | str = "large",
    luma: bool = False,
    profile: _Profile | str = "vga",
    views: int = 8,
    threads: int | None = None,
    crop: _Part | None = None,
    order: _Order = "rgb",
    format: _Format | None = None,
    size: tuple[int, int] | None = None,
) -> Assessment: ...
def draw(
    frame: _Frame,
    detections: Sequence[Detection],
    *,
    poses: Sequence[Pose | None] | None = None,
    order: _Order = "rgb",
    format: _Format | None = None,
    size: tuple[int, int] | None = None,
    stride: int | None = None,
) -> NDArray[np.uint8]: ...
def _png(frame: _Frame) -> bytes: ...
def _restore(data: bytes, name: str | None) -> Model: ...
