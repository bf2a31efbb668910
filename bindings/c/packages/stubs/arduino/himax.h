/* A stand-in for the camera library of Arduino's mbed cores. */
#pragma once
#include <camera.h>
class HM01B0 : public ImageSensor {};
