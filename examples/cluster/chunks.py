"""Pictures and videos in chunks, and the rows of a chunk as a Parquet file.

In: paths of pictures, folders and videos. Out: one file a chunk. The name of the file is made of all that
the rows depend on: the model, the options, the inputs. It appears when it is whole. So a chunk that is
computed twice, since a worker was lost, leaves one file, and a run that is started again computes what is
missing. Memory: one chunk's rows. Cost: that of the searches.

The columns are the fields of docs/detection.md, as schema/detection.json has them.
"""

import hashlib
import json
import os
import tempfile
from pathlib import Path

import keygraph
import pyarrow as pa
import pyarrow.parquet as pq

PICTURES = {".png", ".jpg", ".jpeg"}
VIDEOS = {".mp4", ".mkv", ".webm", ".mov", ".avi", ".gif"}
PICTURES_A_CHUNK = 25

COUNTS = pa.struct([(name, pa.int64()) for name in ("seen", "kept", "dropped")])
DETECTION = pa.struct(
    [
        ("object", pa.string()),
        ("state", pa.string()),
        ("score", pa.float64()),
        ("visible", pa.float64()),
        ("homography", pa.list_(pa.float64())),
        ("corners", pa.list_(pa.list_(pa.float64()))),
        ("votes", pa.int64()),
        ("agreeing", pa.int64()),
        ("correlation", pa.float64()),
        ("support", pa.float64()),
        ("strong", pa.float64()),
        ("blocks", pa.int64()),
        ("inside", pa.int64()),
        ("chroma", pa.float64()),
        ("rivals", pa.list_(pa.struct([("object", pa.string()), ("score", pa.float64())]))),
    ]
)
SCHEMA = pa.schema(
    [
        ("source", pa.string()),
        ("frame", pa.int64()),
        ("error", pa.string()),
        ("width", pa.int64()),
        ("height", pa.int64()),
        ("detections", pa.list_(DETECTION)),
        ("stages", pa.map_(pa.string(), COUNTS)),
        ("time_ms", pa.map_(pa.string(), pa.float64())),
    ]
)


def chunks(inputs):
    """Lists of sources: pictures by some tens, each video by itself. Folders are read in order of names."""
    pictures, videos = [], []
    for given in map(Path, inputs):
        files = sorted(p for p in given.rglob("*") if p.is_file()) if given.is_dir() else [given]
        for file in files:
            suffix = file.suffix.lower()
            if suffix in PICTURES:
                pictures.append(str(file))
            elif suffix in VIDEOS:
                videos.append([str(file)])
            elif file == given:
                # A file that is named must not be left out in silence.
                raise ValueError(f"{file} is no picture ({', '.join(PICTURES)}) and no video ({', '.join(VIDEOS)})")
    parts = range(0, len(pictures), PICTURES_A_CHUNK)
    return [pictures[i : i + PICTURES_A_CHUNK] for i in parts] + videos


def file_of(out, chunk, model, options):
    """The path of the chunk's rows."""
    told = json.dumps([hashlib.sha256(model).hexdigest(), options, chunk], sort_keys=True)
    return os.path.join(out, f"part-{hashlib.sha256(told.encode()).hexdigest()[:16]}.parquet")


def search(detector, chunk, path):
    """Searches all frames of a chunk, and writes their rows; gives their number."""
    rows = [row for source in chunk for row in rows_of(detector, source)]
    table = pa.Table.from_pylist(rows, schema=SCHEMA)
    folder, name = os.path.split(path)
    # In the same folder, so that it can take its name in one step.
    with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{name}-", delete=False) as draft:
        try:
            pq.write_table(table, draft.name)
            os.replace(draft.name, path)
        except BaseException:
            os.unlink(draft.name)
            raise
    return len(rows)


def rows_of(detector, source):
    """The rows of a picture or a video. What cannot be read is a row with the reason."""
    try:
        if Path(source).suffix.lower() in PICTURES:
            yield row(detector.detect(source), source, 0)
        else:
            for index, pixels in enumerate(frames_of(source)):
                yield row(detector.detect(pixels, order="bgr"), source, index)
    except (OSError, ValueError) as error:
        yield {"source": source, "frame": 0, "error": str(error), "detections": []}


def row(found, source, index):
    """The line of a frame with maps as pyarrow takes them."""
    line = found.to_dict(source=source, frame=index)
    return line | {key: list(line[key].items()) for key in ("stages", "time_ms")}


def frames_of(video):
    """The frames of a video, BGR."""
    import cv2

    capture = cv2.VideoCapture(video)
    if not capture.isOpened():
        raise OSError(f"{video}: cannot be opened as a video")
    while True:
        there, pixels = capture.read()
        if not there:
            return
        yield pixels


def detector_of(model, options):
    """A detector of a model's bytes."""
    return keygraph.Detector(keygraph.Model(model), **options)
