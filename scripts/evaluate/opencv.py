"""OpenCV's SIFT and ORB as detectors, for comparison."""

import math
import time

import cv2
import numpy as np
from detectors import Refused
from frames import HEIGHT, WIDTH
from scoring import Detection, Search, outline


class Rival:
    """OpenCV's features with the ratio test and a RANSAC homography.

    An outline is accepted when it keeps ten matches, is convex and larger than 20x20 px.
    """

    def __init__(self, label):
        self.label = label
        self.features = cv2.SIFT_create() if label == "SIFT" else cv2.ORB_create(1000)
        self.matcher = cv2.BFMatcher(cv2.NORM_L2 if label == "SIFT" else cv2.NORM_HAMMING)
        self.models = {}  # digest of the picture -> (points in its pixels, descriptors)

    def model(self, picture):
        """Points and descriptors of the picture at 640x480 or less, as keygraph trains."""
        if picture.digest not in self.models:
            w, h = picture.size
            k = min(1.0, WIDTH / max(w, h), math.sqrt(WIDTH * HEIGHT / (w * h)))
            gray = cv2.cvtColor(picture.pixels, cv2.COLOR_BGR2GRAY)
            if k < 1:
                gray = cv2.resize(gray, None, fx=k, fy=k, interpolation=cv2.INTER_AREA)
            points, descriptors = self.features.detectAndCompute(gray, None)
            if descriptors is None or len(points) < 4:
                raise Refused(f"{picture.path}: {len(points)} features")
            self.models[picture.digest] = (np.float64([(np.add(p.pt, 0.5)) / k - 0.5 for p in points]), descriptors)
        return self.models[picture.digest]

    def size(self, picture):
        """Bytes of descriptors (SIFT's rounded to bytes) and of positions, two bytes a coordinate."""
        descriptors = self.model(picture)[1]
        return descriptors.size + 4 * len(descriptors)

    def search(self, picture, frames):
        """A `Search` for each of `frames`, of 640x480 px or less; decoding is not timed."""
        model = self.model(picture)
        searches = []
        for frame in frames:
            pixels = cv2.imread(frame.path, cv2.IMREAD_COLOR)
            start = time.perf_counter()
            corners = self.outline(pixels, model, picture.size)
            ms = 1e3 * (time.perf_counter() - start)
            searches.append(Search([] if corners is None else [Detection(1.0, corners)], ms))
        return searches

    def outline(self, pixels, model, size):
        """The object's outline in the frame, or None."""
        gray = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        points, descriptors = self.features.detectAndCompute(gray, None)
        if descriptors is None:
            return None
        pairs = [p for p in self.matcher.knnMatch(model[1], descriptors, k=2) if len(p) == 2]
        good = [best for best, second in pairs if best.distance < 0.75 * second.distance]
        if len(good) < 6:
            return None
        there = np.float64([points[m.trainIdx].pt for m in good])
        homography, kept = cv2.findHomography(model[0][[m.queryIdx for m in good]], there, cv2.RANSAC, 4.0)
        if homography is None or kept.sum() < 10:
            return None
        corners = outline(homography.tolist(), size)
        whole = np.float32(corners)
        return corners if cv2.isContourConvex(whole) and cv2.contourArea(whole) > 400 else None
