/* Keygraph as firmware in C: searches the frames that the emulator gives for the model that lies in flash,
   and writes what it finds, and a digest of every stage, as lines of text.

   Memory: the detector and one raw frame, both static; no heap. */
#include <stddef.h>
#include <stdint.h>

#include "keygraph.h"
#include "semihosting.h"

enum { FRAME_BYTES = 2 * 320 * 240, STACK_LIMIT = 9216 };

KG_MEMORY(detector_memory, KG_QVGA_DETECTOR_BYTES);
KG_MEMORY(frame_buffer, FRAME_BYTES);

/* The model, and the end of the region of flash for models. */
extern const uint8_t _model_start[], _model_end[];
__asm__(".section .model, \"a\"\n.incbin \"model.kgm\"\n.text");

uint32_t stack_bytes(void);

#ifdef __arm__
/* CMSDK timer 0 of the emulated board: control, value (counts down), reload. */
#ifndef TIMER
#define TIMER 0x40000000
#endif
/* Time of a tick. */
#ifndef TICK_NS
#define TICK_NS 40
#endif
static volatile uint32_t *const timer = (volatile uint32_t *)TIMER;

static void clock_start(void) {
    timer[2] = UINT32_MAX;
    timer[1] = UINT32_MAX;
    timer[0] = 1;
}

static uint64_t clock_now(void *context) {
    (void)context;
    return UINT32_MAX - timer[1];
}
#else
/* With -icount, the emulator's minstret counts the nanoseconds of its time. */
#define TICK_NS 1

static void clock_start(void) {
}

static uint64_t clock_now(void *context) {
    (void)context;
    uint32_t instructions;
    __asm__ volatile("csrr %0, minstret" : "=r"(instructions));
    return instructions;
}
#endif

/* Lines of text. */
static intptr_t results;

static void text(const char *s) {
    size_t n = 0;
    while (s[n] != 0) {
        n++;
    }
    file_write(results, s, n);
}

static void number(uint32_t v, uint32_t base, uint32_t least_digits) {
    char digits[10];
    uint32_t n = 0;
    do {
        digits[sizeof digits - ++n] = "0123456789abcdef"[v % base];
        v /= base;
    } while (v > 0 || n < least_digits);
    file_write(results, digits + sizeof digits - n, n);
}

/* A coordinate in px, with one decimal. */
static void px(float v) {
    if (v < 0) {
        text("-");
        v = -v;
    }
    const uint32_t tenths = (uint32_t)(v * 10.0f + 0.5f);
    number(tenths / 10, 10, 1);
    text(".");
    number(tenths % 10, 10, 1);
}

/* Ends the run with the text of a status that is an error. */
static void must(kg_status status, const char *what) {
    if (status < 0) {
        text(what);
        text(": ");
        text(kg_status_text(status));
        text("\n");
        end(1);
    }
}

static void panicked(const char *file, size_t file_bytes, uint32_t line) {
    text("panicked at ");
    file_write(results, file, file_bytes);
    text(":");
    number(line, 10, 1);
    text("\n");
}

static void report(kg_detector *detector, const kg_model *model, const uint32_t digests[KG_STAGES]) {
    kg_stats stats;
    must(kg_detector_stats(detector, &stats), "statistics");
    uint64_t ticks = 0;
    for (uint32_t i = 0; i < KG_STAGES; i++) {
        text("digest ");
        text(kg_stage_name(i));
        text(" ");
        number(digests[i], 16, 8);
        text("\n");
        ticks += stats.stages[i].ticks;
    }
    static kg_detection found[KG_DETECTIONS];
    size_t count = 0;
    must(kg_detector_detections(detector, found, KG_DETECTIONS, &count), "detections");
    for (size_t i = 0; i < count; i++) {
        kg_object object;
        must(kg_model_object(model, found[i].object, &object), "object");
        text("found ");
        text(object.name);
        for (uint32_t corner = 0; corner < 4; corner++) {
            text(" ");
            px(found[i].outline[corner][0]);
            text(",");
            px(found[i].outline[corner][1]);
        }
        text("\n");
    }
    /* An instruction takes 16 ns of the emulator's time. */
    text("instructions ");
    number((uint32_t)(ticks * TICK_NS / 16), 10, 1);
    text("\nstack ");
    number(stack_bytes(), 10, 1);
    text("\n");
}

int main(void) {
    results = file_open("results.txt", 11, MODE_WRITE_BINARY);
    const intptr_t frames = file_open("frames.bin", 10, MODE_READ_BINARY);
    if (results < 0 || frames < 0) {
        return 2;
    }
    kg_set_panic_handler(panicked);
    if (kg_abi_version() != KG_ABI_VERSION) {
        text("the library is of another version than its header\n");
        return 1;
    }
    clock_start();

    /* Bytes that are erased follow the model in flash. */
    static kg_model model;
    size_t bytes = 0;
    must(kg_model_bytes(_model_start, (size_t)(_model_end - _model_start), &bytes), "model");
    must(kg_model_open(&model, _model_start, bytes), "model");
    kg_detector *detector = NULL;
    must(kg_detector_init(detector_memory, sizeof detector_memory, KG_PROFILE_QVGA, &detector), "detector");

    const kg_observer observer = {.now = clock_now};
    uint32_t header[3];
    for (uint32_t n = 0; file_read(frames, header, sizeof header); n++) {
        text("frame ");
        number(n, 10, 1);
        text("\n");
        kg_frame frame = {.data = frame_buffer, .format = header[0], .width = header[1], .height = header[2]};
        must(kg_frame_bytes(frame.format, frame.width, frame.height, 0, &frame.bytes), "frame");
        if (frame.bytes > sizeof frame_buffer || !file_read(frames, frame_buffer, frame.bytes)) {
            text("the frame is cut off, or too large\n");
            return 1;
        }
        uint32_t digests[KG_STAGES];
        must(kg_detector_detect_with_digests(detector, &model, &frame, NULL, &observer, digests), "search");
        report(detector, &model, digests);
    }
    return stack_bytes() <= STACK_LIMIT ? 0 : 3;
}
