"""Finds an object before a webcam: `python webcam.py cover.jpg`. Escape ends it."""

import sys

import cv2
import keygraph

tracker = keygraph.Tracker(keygraph.train(sys.argv[1]))
camera = cv2.VideoCapture(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
while camera.isOpened() and cv2.waitKey(1) != 27:
    read, frame = camera.read()
    if not read:
        break
    for found in tracker.track(frame, order="bgr"):
        cv2.polylines(frame, [found.corners.astype(int)], True, (80, 220, 64), 3)
        cv2.putText(frame, f"{found.object} {found.score:.2f}", found.corners[0].astype(int), 0, 1, (80, 220, 64), 2)
    cv2.imshow("keygraph", frame)
