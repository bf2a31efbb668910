# %% [markdown]
# # Find a picture in frames
# A tour of the package, from one picture to a pose in space. Editors that know `# %%` (VS Code, PyCharm,
# Spyder, Jupyter with jupytext) run it cell by cell; `python tutorial.py` runs all of it. It uses the
# pictures of the repository, and prints what it finds. Pictures go to the folder `tutorial-out`, or to the
# one that is named.

# %%
import sys
from pathlib import Path

import keygraph
import numpy as np

assets = Path(__file__).resolve().parents[3] / "assets"
frames = sorted((assets / "sequence").glob("*.jpg"))
out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("tutorial-out")
out.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## Is it a good picture?
# An assessment renders frames of the picture and searches them. `views=8`, the default, gives finer rates.

# %%
assessment = keygraph.assess(assets / "pictures/coffee.jpg", views=1, profile="qvga")
print(assessment)
keygraph.imwrite(out / "heat.png", assessment.heat)

# %% [markdown]
# ## Train
# One picture of the object is enough: from the front, with nothing else on it. A path, an array or a PIL
# image will do.

# %%
astronaut = keygraph.train(assets / "pictures/astronaut.jpg")
coffee = keygraph.train(keygraph.imread(assets / "pictures/coffee.jpg"), name="coffee")
print(astronaut, coffee)
astronaut.save(out / "astronaut.kgm")
assert keygraph.Model.load(out / "astronaut.kgm") == astronaut

# %% [markdown]
# ## Find
# A detector looks for all of its objects at once. Frames of OpenCV have blue first: `order="bgr"`.

# %%
detector = keygraph.Detector([astronaut, coffee])
frame = keygraph.imread(frames[5])
found = detector.detect(frame)
for detection in found:
    print(detection)
    print("  corners, px:", detection.corners.round(1).tolist())
    print("  picture to frame:", detection.homography.round(4).tolist())
assert [d.object for d in found] == ["astronaut"]
assert len(detector.detect(frame[..., ::-1], order="bgr")) == 1

# %% [markdown]
# ## Draw
# A notebook shows `found` as the frame with the outlines. `draw` gives an array.

# %%
drawing = found.draw()
keygraph.imwrite(out / "found.png", drawing)
print(drawing.shape, drawing.dtype, "boxes:", found.xyxy.round().tolist())

# %% [markdown]
# ## Flatten
# The homography maps the object's picture to the frame; its inverse brings what is seen upright.

# %%
(detection,) = found
y, x = np.mgrid[0:512, 0:512]
seen = detection.homography @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
u, v = np.rint(seen[:2] / seen[2]).astype(int)
inside = (u >= 0) & (u < 640) & (v >= 0) & (v < 480)
upright = np.zeros((512 * 512, 3), np.uint8)
upright[inside] = frame[v[inside], u[inside]]
picture = keygraph.imread(assets / "pictures/astronaut.jpg").reshape(-1, 3)
alike = np.corrcoef(upright[inside].ravel(), picture[inside].ravel())[0, 1]
print(f"the flattened object correlates with its picture by {alike:.2f}")
assert alike > 0.9
keygraph.imwrite(out / "upright.png", upright.reshape(512, 512, 3))

# %% [markdown]
# ## Track
# A tracker follows what was found, which takes a small part of a search. Each object keeps its id.

# %%
tracker = keygraph.Tracker([astronaut, coffee])
for path in frames[:12]:
    tracked = tracker.track(path)
    states = [f"{d.object} #{d.id} {d.state}" for d in tracked] + [f"{d.object} #{d.id} lost" for d in tracked.lost]
    print(path.name, "searched" if tracked.searched else "followed", states)

# %% [markdown]
# ## Where it is in space
# With the focal lengths and the principal point of the camera and the true width of the object, its pose
# follows. The frames were rendered with a focal length of 600 px; the print is taken to be 200 mm wide.

# %%
pose = keygraph.pose(detection, (600, 600, 319.5, 239.5), width_mm=200)
assert pose is not None
print(f"{pose.translation_mm.round()} mm from the camera, {pose.error_px:.2f} px off, ambiguous: {pose.ambiguous}")
print(pose.rotation.round(3))
keygraph.imwrite(out / "pose.png", found.draw(poses=[pose]))

# %% [markdown]
# ## For other programs
# `to_dict()` is the line that `keygraph detect --json` prints; docs/detection.md describes its fields.

# %%
line = found.to_dict(source="tutorial", frame=5)
print({key: line[key] for key in ("source", "frame", "width", "height")}, sorted(line["detections"][0]))
