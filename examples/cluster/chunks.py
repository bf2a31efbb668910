"""Pictures and videos in chunks, and the rows of a chunk as a Parquet file.

In: paths of pictures, folders and videos. Out: one file a chunk. The name of the file is made of all that
the rows depend on: the model, the options, the inputs with their sizes and times. It appears when it is
whole. So a chunk that is computed twice, since a worker was lost, leaves one file, and a run that is started
again computes what is missing. Memory: one chunk's rows. Cost: that of the searches.

The columns are the fields of docs/detection.md, as schema/detection.json has them.
"""

import hashlib
import json
import os
import uuid
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
    """Lists of paths: pictures by some tens, each video by itself. Folders are read in order of names."""
    pictures, videos = [], []
    for given in (Path(os.path.abspath(path)) for path in inputs):
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
    files = [(path, os.stat(path).st_size, os.stat(path).st_mtime_ns) for path in chunk]
    told = json.dumps([hashlib.sha256(model).hexdigest(), options, files], sort_keys=True)
    return os.path.join(out, f"part-{hashlib.sha256(told.encode()).hexdigest()[:16]}.parquet")


def strangers(out, files):
    """The files of rows in a folder that are none of these: another run has left them."""
    return sorted(str(path) for path in Path(out).glob("part-*.parquet") if str(path) not in set(files))


def search(detector, chunk, path):
    """Searches all frames of a chunk, and writes their rows; gives their number.

    An OSError leaves no file: what cannot be read now, since a disk is away, may be read by the next run.
    """
    rows = [row for source in chunk for row in rows_of(detector, source)]
    table = pa.Table.from_pylist(rows, schema=SCHEMA)
    folder, name = os.path.split(path)
    # In the same folder, so that it can take its name in one step.
    draft = os.path.join(folder, f".{name}-{uuid.uuid4().hex}")
    try:
        pq.write_table(table, draft)
        os.replace(draft, path)
    finally:
        Path(draft).unlink(missing_ok=True)
    return len(rows)


def rows_of(detector, source):
    """The rows of a picture or a video. A damaged one has a row with the reason, after those that could be read."""
    index = 0
    try:
        if Path(source).suffix.lower() in PICTURES:
            yield row(detector.detect(source), source, index)
        else:
            for pixels in frames_of(source):
                yield row(detector.detect(pixels, order="bgr"), source, index)
                index += 1
    except ValueError as error:
        yield {"source": source, "frame": index, "error": str(error), "detections": []}


def row(found, source, index):
    """The line of a frame with maps as pyarrow takes them."""
    line = found.to_dict(source=source, frame=index)
    return line | {key: list(line[key].items()) for key in ("stages", "time_ms")}


def frames_of(video):
    """The frames of a video, BGR."""
    import cv2

    open(video, "rb").close()  # OpenCV does not tell a file that is away from one that is damaged.
    capture = cv2.VideoCapture(video)
    expected, count = capture.get(cv2.CAP_PROP_FRAME_COUNT), 0
    while True:
        there, pixels = capture.read()
        if not there:
            break
        count += 1
        yield pixels
    # Containers that do not tell their frames say 0 or less.
    if count == 0 or count < expected:
        raise ValueError(f"{video}: damaged or cut off after {count} of {max(int(expected), 1)} frames")


def detector_of(model, options):
    """A detector of a model's bytes."""
    return keygraph.Detector(keygraph.Model(model), **options)
