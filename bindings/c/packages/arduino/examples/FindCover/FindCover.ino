/* Finds a cover in front of the camera, and prints what it sees.

   Boards: Portenta H7 with Vision Shield (gray, 320x240 px), Nicla Vision (colour, 160x120 px).
   Before: keygraph train cover.jpg --preset compact -o cover.kgm      (--luma for the Portenta's camera)
           xxd -i -n model cover.kgm | sed 's/unsigned char/alignas(4) const unsigned char/' > model.h
   It has not been run on a board yet. */
#include <camera.h>
#include <keygraph.h>

#include "model.h"

#if defined(ARDUINO_NICLA_VISION)
#include <gc2145.h>
GC2145 sensor;
const int MODE = CAMERA_RGB565, SIZE = CAMERA_R160x120;
const uint32_t WIDTH = 160, HEIGHT = 120, FRAME_BYTES = 2 * 160 * 120;
/* This camera's library gives the high byte first. */
const kg_format FORMAT = KG_FORMAT_RGB565_BE;
const kg_profile PROFILE = KG_PROFILE_QQVGA;
KG_MEMORY(memory, KG_QQVGA_DETECTOR_BYTES);
#else
#include <himax.h>
HM01B0 sensor;
const int MODE = CAMERA_GRAYSCALE, SIZE = CAMERA_R320x240;
const uint32_t WIDTH = 320, HEIGHT = 240, FRAME_BYTES = 320 * 240;
const kg_format FORMAT = KG_FORMAT_GRAY8;
const kg_profile PROFILE = KG_PROFILE_QVGA;
KG_MEMORY(memory, KG_QVGA_DETECTOR_BYTES);
#endif

Camera camera(sensor);
FrameBuffer frames;
kg_model model_opened;
kg_detector *detector;

/* Prints what is wrong, and stops. */
void must(kg_status status, const char *what) {
  while (status < 0) {
    Serial.print(what);
    Serial.print(": ");
    Serial.println(kg_status_text(status));
    delay(5000);
  }
}

void setup() {
  Serial.begin(115200);
  while (!Serial) {
  }
  must(kg_model_open(&model_opened, model, model_len), "model");
  must(kg_detector_init(memory, sizeof memory, PROFILE, &detector), "detector");
  while (!camera.begin(SIZE, MODE, 15)) {
    Serial.println("camera: it does not start");
    delay(5000);
  }
}

void loop() {
  if (camera.grabFrame(frames, 3000) != 0) {
    return;
  }
  kg_frame frame = {};
  frame.data = frames.getBuffer();
  frame.bytes = FRAME_BYTES;
  frame.format = FORMAT;
  frame.width = WIDTH;
  frame.height = HEIGHT;
  must(kg_detector_detect(detector, &model_opened, &frame, nullptr, nullptr), "search");
  static kg_detection found[KG_DETECTIONS];
  size_t count = 0;
  must(kg_detector_detections(detector, found, KG_DETECTIONS, &count), "detections");
  for (size_t i = 0; i < count; i++) {
    kg_object object;
    must(kg_model_object(&model_opened, found[i].object, &object), "object");
    Serial.print(object.name);
    Serial.print(" ");
    Serial.print(found[i].score);
    for (int corner = 0; corner < 4; corner++) {
      Serial.print(corner == 0 ? " (" : " (");
      Serial.print(found[i].outline[corner][0]);
      Serial.print(", ");
      Serial.print(found[i].outline[corner][1]);
      Serial.print(")");
    }
    Serial.println();
  }
}
