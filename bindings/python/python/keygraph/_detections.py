"""The result of a frame: a list of detections, and what is known of the frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from keygraph._keygraph import Answer, Detection, _png, draw

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from keygraph._keygraph import Pose, _Frame


class Detections(list[Detection]):
    """The objects found in one frame, best score first.

    A list of :class:`Detection`, with the values of all of them as arrays, for OpenCV, supervision and
    the like. In a notebook it shows the frame with the outlines.

    It keeps the frame (the object that was passed, not a copy) until it is deleted. An array that is
    written to later is drawn as it is then.
    """

    def __init__(self, detections: Sequence[Detection], answer: Answer, frame: _Frame, reading: dict[str, Any]) -> None:
        """Detectors and trackers call this; programs need not."""
        super().__init__(detections)
        self._answer = answer
        self._frame = frame
        self._reading = reading

    @property
    def width(self) -> int:
        """Width of the frame, px."""
        return self._answer.width

    @property
    def height(self) -> int:
        """Height of the frame, px."""
        return self._answer.height

    @property
    def complete(self) -> bool:
        """Whether the search came to its end; False when `budget_ms` stopped it."""
        return self._answer.complete

    @property
    def searched(self) -> bool:
        """Whether the frame was searched; False when a tracker only followed what it knew."""
        return self._answer.searched is not False

    @property
    def lost(self) -> list[Detection]:
        """What a tracker lost less than 30 frames ago, at the place where it was seen last."""
        return self._answer.lost()

    @property
    def time_ms(self) -> dict[str, float]:
        """Time of each stage and in `total`, ms, from the pixels to the detections."""
        return self._answer.time_ms

    @property
    def corners(self) -> NDArray[np.float32]:
        """Array of shape (N, 4, 2), px: top left, top right, bottom right and bottom left of each object."""
        return np.array([d.corners for d in self], np.float32).reshape(-1, 4, 2)

    @property
    def polygons(self) -> list[NDArray[np.int32]]:
        """The outlines as arrays of shape (4, 2), whole px, as `cv2.polylines` takes them."""
        return [np.rint(np.clip(d.corners, -1e6, 1e6)).astype(np.int32) for d in self]

    @property
    def xyxy(self) -> NDArray[np.float32]:
        """Array of shape (N, 4), px: left, top, right and bottom of the upright boxes."""
        return np.array([d.xyxy for d in self], np.float32).reshape(-1, 4)

    @property
    def scores(self) -> NDArray[np.float32]:
        """Array of shape (N,): the scores, 0 to 1."""
        return np.array([d.score for d in self], np.float32)

    @property
    def indices(self) -> NDArray[np.int64]:
        """Array of shape (N,): the index of each object in the model."""
        return np.array([d.index for d in self], np.int64)

    @property
    def ids(self) -> NDArray[np.int64] | None:
        """Array of shape (N,): the ids of a tracker; None without one."""
        if self._answer.searched is None:
            return None
        return np.array([d.id for d in self], np.int64)

    def to_dict(self, source: str | None = None, frame: int = 0) -> dict[str, Any]:
        """The line that `keygraph detect --json` prints; docs/detection.md describes the fields.

        `source` is the name of the input (the path that was given, or else an empty text), and `frame`
        the index of the frame in it.
        """
        return self._answer.line(source, frame)

    def draw(
        self,
        frame: _Frame | None = None,
        *,
        poses: Sequence[Pose | None] | None = None,
        order: str | None = None,
    ) -> NDArray[np.uint8]:
        """An array of shape (H, W, 3), RGB: the frame with outlines, names, scores and axes.

        Without `frame`, the frame that was searched is drawn into; a given one may have another `order`.
        """
        if frame is None:
            reading = self._reading if order is None else {**self._reading, "order": order}
            return draw(self._frame, self, poses=poses, **reading)
        return draw(frame, self, poses=poses, order=order or "rgb")

    def to_supervision(self) -> Any:
        """A `supervision.Detections` with boxes, scores, indices, ids, names and corners."""
        import supervision  # type: ignore[import-not-found, unused-ignore]

        return supervision.Detections(
            xyxy=self.xyxy,
            confidence=self.scores,
            class_id=self.indices,
            tracker_id=self.ids,
            data={"class_name": np.array([d.object for d in self], dtype=str), "corners": self.corners},
        )

    def _repr_png_(self) -> bytes:
        return _png(self.draw())
