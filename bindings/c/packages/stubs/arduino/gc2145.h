/* A stand-in for the camera library of Arduino's mbed cores. */
#pragma once
#include <camera.h>
class GC2145 : public ImageSensor {};
