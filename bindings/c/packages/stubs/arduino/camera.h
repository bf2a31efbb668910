/* A stand-in for the camera library of Arduino's mbed cores. */
#pragma once
#include <Arduino.h>

enum { CAMERA_R160x120, CAMERA_R320x240 };
enum { CAMERA_GRAYSCALE, CAMERA_RGB565 };
class ImageSensor {};
class FrameBuffer {
public:
  uint8_t *getBuffer() { return pixels; }

private:
  uint8_t pixels[4];
};
class Camera {
public:
  explicit Camera(ImageSensor &) {}
  bool begin(int32_t, int32_t, int32_t) { return true; }
  int grabFrame(FrameBuffer &, uint32_t) { return 0; }
};
