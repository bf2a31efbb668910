/* Finds a cover in frames of 320x240 px, YUYV. Fill in next_frame() with your camera's driver.
 *
 * Before: keygraph train cover.jpg --preset compact -o main/cover.kgm
 * It has been compiled only. A search takes some 9 KB of stack: set CONFIG_ESP_MAIN_TASK_STACK_SIZE=12288. */
#include <stdio.h>

#include "keygraph.h"

extern const uint8_t cover_start[] asm("_binary_cover_kgm_start");
extern const uint8_t cover_end[] asm("_binary_cover_kgm_end");

KG_MEMORY(memory, KG_QVGA_DETECTOR_BYTES);

/* The next frame, 2 * 320 * 240 bytes; NULL when the camera has stopped. */
static const uint8_t *next_frame(void) {
    return NULL;
}

void app_main(void) {
    static kg_model model;
    kg_detector *detector = NULL;
    kg_status status = kg_model_open(&model, cover_start, (size_t)(cover_end - cover_start));
    if (status >= 0) {
        status = kg_detector_init(memory, sizeof memory, KG_PROFILE_QVGA, &detector);
    }
    for (const uint8_t *data; status >= 0 && (data = next_frame()) != NULL;) {
        const kg_frame frame = {
            .data = data, .bytes = 2 * 320 * 240, .format = KG_FORMAT_YUYV, .width = 320, .height = 240};
        static kg_detection found[KG_DETECTIONS];
        size_t count = 0;
        status = kg_detector_detect(detector, &model, &frame, NULL, NULL);
        if (status >= 0) {
            status = kg_detector_detections(detector, found, KG_DETECTIONS, &count);
        }
        for (size_t i = 0; i < count; i++) {
            printf("object %u, score %.2f, at %.0f, %.0f\n", (unsigned)found[i].object, (double)found[i].score,
                (double)found[i].outline[0][0], (double)found[i].outline[0][1]);
        }
    }
    printf("%s\n", kg_status_text(status));
}
