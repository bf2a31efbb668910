/* Every error of the interface, and what holds after it. Run with AddressSanitizer and UBSan.

     errors PICTURE.ppm      a picture of 512 x 512 px that can be trained

   Exit status: 0 if every check holds. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "keygraph.h"

static int checks, failures;

static void expect(kg_status got, kg_status wanted, const char *what, int line) {
    checks++;
    if (got != wanted) {
        failures++;
        printf("line %d: %s: %d (%s), not %d\n", line, what, got, kg_status_text(got), wanted);
    }
}

static void holds(int true_, const char *what, int line) {
    checks++;
    if (!true_) {
        failures++;
        printf("line %d: %s\n", line, what);
    }
}

#define EXPECT(wanted, call) expect((call), (wanted), #call, __LINE__)
#define HOLDS(condition) holds((condition) != 0, #condition, __LINE__)

enum { W = 512, H = 512 };

/* Memory is from malloc, so that AddressSanitizer sees a byte too many. */
static unsigned char *memory(size_t bytes) {
    unsigned char *m = malloc(bytes);
    if (m == NULL) {
        exit(2);
    }
    memset(m, 0xa5, bytes);
    return m;
}

static unsigned char *read_picture(const char *path) {
    unsigned char *pixels = memory(3 * W * H);
    FILE *f = fopen(path, "rb");
    if (f == NULL || fscanf(f, "P6 512 512 255") != 0 || fgetc(f) == EOF || fread(pixels, 3, W * H, f) != W * H) {
        printf("%s: this is no PPM of %d x %d px\n", path, W, H);
        exit(2);
    }
    fclose(f);
    return pixels;
}

static kg_frame whole(const unsigned char *pixels) {
    const kg_frame frame = {.data = pixels, .bytes = 3 * W * H, .format = KG_FORMAT_RGB8, .width = W, .height = H};
    return frame;
}

static void texts_and_names(void) {
    HOLDS(kg_abi_version() == KG_ABI_VERSION);
    HOLDS(strcmp(kg_version_text(), VERSION) == 0);
    HOLDS(strcmp(kg_status_text(KG_OK), "ok") == 0);
    HOLDS(strcmp(kg_status_text(12345), kg_status_text(-12345)) == 0);
    HOLDS(strcmp(kg_stage_name(0), "convert") == 0);
    HOLDS(kg_stage_name(KG_STAGES) == NULL && kg_buffer_name(KG_BUFFERS) == NULL);
    for (uint32_t i = 0; i < KG_STAGES; i++) {
        HOLDS(kg_stage_name(i) != NULL);
    }
}

static void frames(void) {
    size_t n = 0;
    EXPECT(KG_OK, kg_frame_bytes(KG_FORMAT_YUYV, 320, 240, 0, &n));
    HOLDS(n == 2 * 320 * 240);
    EXPECT(KG_OK, kg_frame_bytes(KG_FORMAT_NV12, 320, 240, 0, &n));
    HOLDS(n == 320 * 240 * 3 / 2);
    EXPECT(KG_OK, kg_frame_bytes(KG_FORMAT_GRAY8, 320, 240, 512, &n));
    HOLDS(n == 512 * 239 + 320);
    EXPECT(KG_ERROR_NULL, kg_frame_bytes(KG_FORMAT_GRAY8, 320, 240, 0, NULL));
    EXPECT(KG_ERROR_FORMAT, kg_frame_bytes(8, 320, 240, 0, &n));
    EXPECT(KG_ERROR_FORMAT, kg_frame_bytes(UINT32_MAX, 320, 240, 0, &n));
    EXPECT(KG_ERROR_TOO_SMALL, kg_frame_bytes(KG_FORMAT_GRAY8, 15, 240, 0, &n));
    EXPECT(KG_ERROR_TOO_LARGE, kg_frame_bytes(KG_FORMAT_GRAY8, 40000, 240, 0, &n));
    EXPECT(KG_ERROR_TOO_LARGE, kg_frame_bytes(KG_FORMAT_GRAY8, UINT32_MAX, UINT32_MAX, 0, &n));
    EXPECT(KG_ERROR_ODD_WIDTH, kg_frame_bytes(KG_FORMAT_YUYV, 321, 240, 0, &n));
    EXPECT(KG_ERROR_ODD_HEIGHT, kg_frame_bytes(KG_FORMAT_NV12, 320, 241, 0, &n));
    EXPECT(KG_ERROR_STRIDE, kg_frame_bytes(KG_FORMAT_RGB8, 320, 240, 959, &n));
    EXPECT(KG_ERROR_STRIDE, kg_frame_bytes(KG_FORMAT_I420, 320, 240, 321, &n));
    EXPECT(KG_ERROR_LENGTH, kg_frame_bytes(KG_FORMAT_GRAY8, 320, 240, SIZE_MAX, &n));
}

/* Trains the model that the other tests use. */
static unsigned char *train(const unsigned char *pixels, size_t *bytes) {
    unsigned char *m = memory(KG_VGA_TRAINER_BYTES + 1);
    kg_trainer *t = NULL;
    EXPECT(KG_ERROR_NULL, kg_trainer_init(NULL, KG_VGA_TRAINER_BYTES, KG_PROFILE_VGA, &t));
    EXPECT(KG_ERROR_NULL, kg_trainer_init(m, KG_VGA_TRAINER_BYTES, KG_PROFILE_VGA, NULL));
    EXPECT(KG_ERROR_MEMORY, kg_trainer_init(m, KG_VGA_TRAINER_BYTES - 1, KG_PROFILE_VGA, &t));
    EXPECT(KG_ERROR_ALIGNMENT, kg_trainer_init(m + 1, KG_VGA_TRAINER_BYTES, KG_PROFILE_VGA, &t));
    EXPECT(KG_ERROR_PROFILE, kg_trainer_init(m, KG_VGA_TRAINER_BYTES, KG_PROFILE_HD, &t));
    HOLDS(t == NULL);
    EXPECT(KG_OK, kg_trainer_init(m, KG_VGA_TRAINER_BYTES, KG_PROFILE_VGA, &t));

    kg_frame frame = whole(pixels);
    kg_training what = {.name = "box", .preset = KG_PRESET_COMPACT};
    kg_trained trained = {0};
    const size_t room = 512 << 10;
    unsigned char *out = memory(room);
    EXPECT(KG_ERROR_HANDLE, kg_trainer_train((kg_trainer *)out, &frame, &what, out, room, &trained));
    EXPECT(KG_ERROR_NULL, kg_trainer_train(NULL, &frame, &what, out, room, &trained));
    EXPECT(KG_ERROR_NULL, kg_trainer_train(t, NULL, &what, out, room, &trained));
    EXPECT(KG_ERROR_NULL, kg_trainer_train(t, &frame, NULL, out, room, &trained));
    EXPECT(KG_ERROR_NULL, kg_trainer_train(t, &frame, &what, NULL, room, &trained));
    EXPECT(KG_ERROR_NULL, kg_trainer_train(t, &frame, &what, out, room, NULL));
    EXPECT(KG_ERROR_LENGTH, kg_trainer_train(t, &frame, &what, out, SIZE_MAX, &trained));
    EXPECT(KG_ERROR_BUFFER, kg_trainer_train(t, &frame, &what, out, 100, &trained));
    what.preset = 5;
    EXPECT(KG_ERROR_PRESET, kg_trainer_train(t, &frame, &what, out, room, &trained));
    what.preset = KG_PRESET_COMPACT;
    what.name = "";
    EXPECT(KG_ERROR_NAME, kg_trainer_train(t, &frame, &what, out, room, &trained));
    what.name = "a name of more than thirty-two bytes";
    EXPECT(KG_ERROR_NAME, kg_trainer_train(t, &frame, &what, out, room, &trained));
    what.name = "\xff\xfe";
    EXPECT(KG_ERROR_NAME, kg_trainer_train(t, &frame, &what, out, room, &trained));
    what.name = NULL;
    EXPECT(KG_ERROR_NULL, kg_trainer_train(t, &frame, &what, out, room, &trained));
    what.name = "box";
    what.original_width = 1 << 21;
    what.original_height = 100;
    EXPECT(KG_ERROR_ORIGINAL, kg_trainer_train(t, &frame, &what, out, room, &trained));
    what.original_width = what.original_height = 0;
    frame.window.width = frame.window.height = 16;
    EXPECT(KG_ERROR_TOO_NARROW, kg_trainer_train(t, &frame, &what, out, room, &trained));
    frame.window.width = frame.window.height = 0;
    unsigned char *gray = memory(W * H);
    const kg_frame plain = {.data = gray, .bytes = W * H, .format = KG_FORMAT_GRAY8, .width = W, .height = H};
    EXPECT(KG_ERROR_NO_TEXTURE, kg_trainer_train(t, &plain, &what, out, room, &trained));
    free(gray);
    EXPECT(KG_OK, kg_trainer_train(t, &frame, &what, out, room, &trained));
    HOLDS(trained.bytes > 100000 && trained.bytes <= room && trained.keypoints > 100 && trained.keygraphs > 1000);
    free(m);
    /* Exactly the model, so that a byte too many is seen. */
    *bytes = trained.bytes;
    return realloc(out, trained.bytes);
}

static void models(const unsigned char *bytes, size_t n) {
    kg_model m;
    memset(&m, 0, sizeof m);
    kg_model_info info;
    kg_object object;
    EXPECT(KG_ERROR_HANDLE, kg_model_describe(&m, &info));
    EXPECT(KG_ERROR_NULL, kg_model_open(NULL, bytes, n));
    EXPECT(KG_ERROR_NULL, kg_model_open(&m, NULL, n));
    EXPECT(KG_ERROR_LENGTH, kg_model_open(&m, bytes, SIZE_MAX));
    EXPECT(KG_ERROR_ALIGNMENT, kg_model_open((kg_model *)((uintptr_t)&m + 4), bytes, n));
    EXPECT(KG_ERROR_NOT_A_MODEL, kg_model_open(&m, bytes, 0));
    EXPECT(KG_ERROR_NOT_A_MODEL, kg_model_open(&m, bytes + 1, n - 1));
    EXPECT(KG_ERROR_TRUNCATED, kg_model_open(&m, bytes, n - 1));
    EXPECT(KG_ERROR_TRUNCATED, kg_model_open(&m, bytes, 20));
    unsigned char *copy = memory(n + 8);
    memcpy(copy, bytes, n);
    EXPECT(KG_ERROR_TRAILING, kg_model_open(&m, copy, n + 8));
    size_t length = 0;
    EXPECT(KG_OK, kg_model_bytes(copy, n + 8, &length));
    HOLDS(length == n);
    EXPECT(KG_OK, kg_model_bytes(copy, n, &length));
    HOLDS(length == n);
    EXPECT(KG_ERROR_TRUNCATED, kg_model_bytes(copy, n - 1, &length));
    EXPECT(KG_ERROR_NULL, kg_model_bytes(copy, n, NULL));
    EXPECT(KG_ERROR_NULL, kg_model_bytes(NULL, n, &length));
    copy[n / 2] ^= 1;
    EXPECT(KG_ERROR_CHECKSUM, kg_model_open(&m, copy, n));
    copy[n / 2] ^= 1;
    copy[4]++;
    EXPECT(KG_ERROR_NEWER_MODEL, kg_model_open(&m, copy, n));
    copy[4] -= 2;
    EXPECT(KG_ERROR_OLDER_MODEL, kg_model_open(&m, copy, n));
    EXPECT(KG_ERROR_HANDLE, kg_model_describe(&m, &info)); /* none of them has opened it */
    free(copy);

    EXPECT(KG_OK, kg_model_open(&m, bytes, n));
    EXPECT(KG_OK, kg_model_describe(&m, &info));
    HOLDS(info.objects == 1 && info.bytes == n && info.colour == 1 && info.paper == 0 && info.keygraphs > 1000);
    EXPECT(KG_OK, kg_model_object(&m, 0, &object));
    HOLDS(strcmp(object.name, "box") == 0 && object.width == W && object.height == H);
    EXPECT(KG_ERROR_INDEX, kg_model_object(&m, 1, &object));
    EXPECT(KG_ERROR_INDEX, kg_model_object(&m, UINT32_MAX, &object));
    EXPECT(KG_ERROR_NULL, kg_model_object(&m, 0, NULL));
    EXPECT(KG_ERROR_NULL, kg_model_object(NULL, 0, &object));
    EXPECT(KG_ERROR_NULL, kg_model_describe(&m, NULL));
}

/* What a callback does. */
struct context {
    kg_detector *detector;
    const kg_model *model;
    const kg_frame *frame;
    uint64_t ticks;
    int questions, stop_at;
};

static uint64_t now(void *context) {
    return ((struct context *)context)->ticks += 10;
}

static int32_t goes_on(void *context) {
    struct context *c = context;
    kg_stats stats;
    if (c->questions == 0) {
        /* The detector is at work. */
        EXPECT(KG_ERROR_BUSY, kg_detector_detect(c->detector, c->model, c->frame, NULL, NULL));
        EXPECT(KG_ERROR_BUSY, kg_detector_stats(c->detector, &stats));
        EXPECT(KG_ERROR_BUSY, kg_detector_cancel(c->detector));
    }
    return ++c->questions != c->stop_at;
}

static void detectors(const kg_model *model, const unsigned char *pixels) {
    unsigned char *m = memory(KG_VGA_DETECTOR_BYTES + 1);
    kg_detector *d = NULL;
    size_t n = 0;
    EXPECT(KG_OK, kg_detector_bytes(KG_PROFILE_VGA, &n));
    HOLDS(n == KG_VGA_DETECTOR_BYTES);
    EXPECT(KG_ERROR_PROFILE, kg_detector_bytes(4, &n));
    EXPECT(KG_ERROR_NULL, kg_detector_bytes(KG_PROFILE_HD, NULL));
    EXPECT(KG_ERROR_NULL, kg_detector_init(NULL, KG_VGA_DETECTOR_BYTES, KG_PROFILE_VGA, &d));
    EXPECT(KG_ERROR_NULL, kg_detector_init(m, KG_VGA_DETECTOR_BYTES, KG_PROFILE_VGA, NULL));
    EXPECT(KG_ERROR_MEMORY, kg_detector_init(m, KG_VGA_DETECTOR_BYTES - 1, KG_PROFILE_VGA, &d));
    EXPECT(KG_ERROR_MEMORY, kg_detector_init(m, KG_VGA_DETECTOR_BYTES, KG_PROFILE_HD, &d));
    EXPECT(KG_ERROR_ALIGNMENT, kg_detector_init(m + 1, KG_VGA_DETECTOR_BYTES, KG_PROFILE_VGA, &d));
    EXPECT(KG_ERROR_ALIGNMENT, kg_detector_init(m + 4, KG_VGA_DETECTOR_BYTES - 4, KG_PROFILE_VGA, &d));
    EXPECT(KG_ERROR_LENGTH, kg_detector_init(m, SIZE_MAX, KG_PROFILE_VGA, &d));
    EXPECT(KG_ERROR_PROFILE, kg_detector_init(m, KG_VGA_DETECTOR_BYTES, 99, &d));
    HOLDS(d == NULL);
    EXPECT(KG_ERROR_HANDLE, kg_detector_step((kg_detector *)m, NULL));
    EXPECT(KG_OK, kg_detector_init(m, KG_VGA_DETECTOR_BYTES, KG_PROFILE_VGA, &d));
    HOLDS((unsigned char *)d == m);

    kg_frame frame = whole(pixels);
    kg_detection found[4];
    size_t count = 7;
    EXPECT(KG_OK, kg_detector_detections(d, found, 4, &count));
    HOLDS(count == 0);
    EXPECT(KG_ERROR_NO_SEARCH, kg_detector_step(d, NULL));
    EXPECT(KG_OK, kg_detector_cancel(d));

    /* Frames. */
    EXPECT(KG_ERROR_NULL, kg_detector_detect(NULL, model, &frame, NULL, NULL));
    EXPECT(KG_ERROR_NULL, kg_detector_detect(d, NULL, &frame, NULL, NULL));
    EXPECT(KG_ERROR_NULL, kg_detector_detect(d, model, NULL, NULL, NULL));
    frame.data = NULL;
    EXPECT(KG_ERROR_NULL, kg_detector_detect(d, model, &frame, NULL, NULL));
    frame = whole(pixels);
    frame.bytes--;
    EXPECT(KG_ERROR_FRAME_LENGTH, kg_detector_detect(d, model, &frame, NULL, NULL));
    frame.bytes = SIZE_MAX;
    EXPECT(KG_ERROR_LENGTH, kg_detector_detect(d, model, &frame, NULL, NULL));
    frame = whole(pixels);
    frame.format = 77;
    EXPECT(KG_ERROR_FORMAT, kg_detector_detect(d, model, &frame, NULL, NULL));
    frame = whole(pixels);
    frame.window.x = 1;
    frame.window.width = W;
    frame.window.height = H;
    EXPECT(KG_ERROR_WINDOW, kg_detector_detect(d, model, &frame, NULL, NULL));
    frame.window.x = UINT32_MAX;
    EXPECT(KG_ERROR_WINDOW, kg_detector_detect(d, model, &frame, NULL, NULL));
    const kg_frame yuyv = {
        .data = pixels, .bytes = 2 * W * H, .format = KG_FORMAT_YUYV, .width = W, .height = H, .window = {3, 0, 32, 32}};
    EXPECT(KG_ERROR_WINDOW_ODD, kg_detector_detect(d, model, &yuyv, NULL, NULL));
    unsigned char *large = memory(800 * 600);
    kg_frame too_large = {.data = large, .bytes = 800 * 600, .format = KG_FORMAT_GRAY8, .width = 800, .height = 600};
    EXPECT(KG_ERROR_TOO_LARGE, kg_detector_detect(d, model, &too_large, NULL, NULL));
    too_large.window.width = too_large.window.height = 320;
    EXPECT(KG_OK, kg_detector_detect(d, model, &too_large, NULL, NULL)); /* the window fits */
    free(large);

    /* Options and observers. */
    frame = whole(pixels);
    kg_options options = {.threshold = 1.5f};
    EXPECT(KG_ERROR_OPTION, kg_detector_detect(d, model, &frame, &options, NULL));
    options = (kg_options){.threshold = 0.8f, .min_visible = -1.0f};
    EXPECT(KG_ERROR_OPTION, kg_detector_detect(d, model, &frame, &options, NULL));
    options = (kg_options){.threshold = 0.8f, .depth = 3};
    EXPECT(KG_ERROR_OPTION, kg_detector_detect(d, model, &frame, &options, NULL));
    kg_observer observer = {.budget = 100};
    EXPECT(KG_ERROR_OPTION, kg_detector_detect(d, model, &frame, NULL, &observer)); /* no clock */
    EXPECT(KG_ERROR_ALIGNMENT, kg_detector_detect(d, model, &frame, (kg_options *)((uintptr_t)&options + 1), NULL));

    /* A search. */
    EXPECT(KG_OK, kg_detector_detect(d, model, &frame, NULL, NULL));
    EXPECT(KG_OK, kg_detector_detections(d, found, 4, &count));
    HOLDS(count == 1 && found[0].object == 0 && found[0].score > 0.9f && found[0].rivals == 0);
    HOLDS(found[0].outline[2][0] > W - 9 && found[0].outline[2][1] > H - 9 && found[0].visible > 0.8f);
    const kg_detection first = found[0];
    EXPECT(KG_OK, kg_detector_detections(d, NULL, 0, &count));
    HOLDS(count == 1);
    EXPECT(KG_ERROR_NULL, kg_detector_detections(d, NULL, 1, &count));
    EXPECT(KG_ERROR_NULL, kg_detector_detections(d, found, 1, NULL));
    EXPECT(KG_ERROR_LENGTH, kg_detector_detections(d, found, SIZE_MAX, &count));
    EXPECT(KG_OK, kg_detector_rivals(d, 0, found, 4, &count));
    HOLDS(count == 0);
    EXPECT(KG_ERROR_INDEX, kg_detector_rivals(d, 1, found, 4, &count));
    kg_surface surface;
    EXPECT(KG_OK, kg_detector_surface(d, model, 0, NULL, &surface));
    HOLDS(!surface.bent && surface.points[0][0][0] == first.outline[0][0] && surface.points[0][0][1] == first.outline[0][1]);
    HOLDS(fabsf(surface.points[KG_SURFACE_SIDE - 1][KG_SURFACE_SIDE - 1][0] - first.outline[2][0]) < 0.01f);
    EXPECT(KG_ERROR_INDEX, kg_detector_surface(d, model, 1, NULL, &surface));
    kg_lens lens = {.intrinsics = {W, W, W / 2, H / 2}};
    EXPECT(KG_OK, kg_detector_surface(d, model, 0, &lens, &surface));
    HOLDS(!surface.bent && fabsf(surface.points[0][0][0] - first.outline[0][0]) < 1.5f);
    lens.fisheye = 2;
    EXPECT(KG_ERROR_OPTION, kg_detector_surface(d, model, 0, &lens, &surface));
    lens.fisheye = 1;
    lens.intrinsics.fx = 0;
    EXPECT(KG_ERROR_INTRINSICS, kg_detector_surface(d, model, 0, &lens, &surface));
    EXPECT(KG_ERROR_NULL, kg_detector_surface(d, model, 0, NULL, NULL));
    EXPECT(KG_ERROR_NULL, kg_detector_surface(NULL, model, 0, NULL, &surface));
    kg_buffer buffer;
    EXPECT(KG_OK, kg_detector_buffer(d, 0, &buffer));
    HOLDS(buffer.bytes == 408000 && buffer.most > 0 && buffer.most <= buffer.capacity);
    EXPECT(KG_ERROR_INDEX, kg_detector_buffer(d, KG_BUFFERS, &buffer));
    kg_stats stats;
    EXPECT(KG_ERROR_NULL, kg_detector_stats(d, NULL));
    EXPECT(KG_OK, kg_detector_stats(d, &stats));
    HOLDS(stats.stages[2].kept > 0 && stats.stopped == 0 && stats.searched == 1 && stats.stages[2].ticks == 0);

    /* Calls from within, a stop, a budget. */
    struct context c = {.detector = d, .model = model, .frame = &frame, .stop_at = -1};
    observer = (kg_observer){.context = &c, .now = now, .goes_on = goes_on};
    EXPECT(KG_OK, kg_detector_detect(d, model, &frame, NULL, &observer));
    EXPECT(KG_OK, kg_detector_stats(d, &stats));
    HOLDS(c.questions > 10 && stats.stages[2].ticks > 0);
    c.stop_at = 1;
    c.questions = 0;
    EXPECT(KG_STOPPED, kg_detector_detect(d, model, &frame, NULL, &observer));
    EXPECT(KG_OK, kg_detector_stats(d, &stats));
    HOLDS(c.questions == 1 && stats.stopped == 1);
    observer.goes_on = NULL;
    observer.budget = 200;
    EXPECT(KG_STOPPED, kg_detector_detect(d, model, &frame, NULL, &observer));

    /* In pieces: the same result. */
    EXPECT(KG_MORE, kg_detector_begin(d, model, &frame, NULL, NULL));
    EXPECT(KG_ERROR_BUSY, kg_detector_stats(d, &stats));
    EXPECT(KG_ERROR_BUSY, kg_detector_buffer(d, 0, &buffer));
    EXPECT(KG_OK, kg_detector_detections(d, found, 4, &count));
    int steps = 1;
    kg_status status;
    while ((status = kg_detector_step(d, NULL)) == KG_MORE) {
        steps++;
    }
    EXPECT(KG_OK, status);
    HOLDS(steps > 2);
    EXPECT(KG_OK, kg_detector_detections(d, found, 4, &count));
    HOLDS(count == 1 && memcmp(&found[0], &first, sizeof first) == 0);
    EXPECT(KG_ERROR_NO_SEARCH, kg_detector_step(d, NULL));
    /* The frame that was read is searched again: for the same model the same result. */
    EXPECT(KG_MORE, kg_detector_begin_again(d, model, NULL, NULL));
    while ((status = kg_detector_step(d, NULL)) == KG_MORE) {
    }
    EXPECT(KG_OK, status);
    EXPECT(KG_OK, kg_detector_detections(d, found, 4, &count));
    HOLDS(count == 1 && memcmp(&found[0], &first, sizeof first) == 0);
    EXPECT(KG_ERROR_NULL, kg_detector_begin_again(NULL, model, NULL, NULL));
    EXPECT(KG_ERROR_NULL, kg_detector_begin_again(d, NULL, NULL, NULL));
    EXPECT(KG_ERROR_OPTION, kg_detector_begin_again(d, model, &(kg_options){.threshold = 2.0f}, NULL));
    EXPECT(KG_MORE, kg_detector_begin(d, model, &frame, NULL, NULL));
    EXPECT(KG_OK, kg_detector_cancel(d));
    EXPECT(KG_ERROR_NO_SEARCH, kg_detector_step(d, NULL));
    EXPECT(KG_MORE, kg_detector_begin(d, model, &frame, NULL, NULL));
    EXPECT(KG_OK, kg_detector_detect(d, model, &frame, NULL, NULL)); /* gives the search up */
    EXPECT(KG_ERROR_NO_SEARCH, kg_detector_step(d, NULL));
    EXPECT(KG_ERROR_FRAME_LENGTH, kg_detector_begin(d, model, &(kg_frame){.data = pixels, .width = W, .height = H}, NULL, NULL));

    /* A window: results are in px of the whole frame. */
    unsigned char *beside = memory(3 * (W + 64) * (H + 64));
    for (int y = 0; y < H; y++) {
        memcpy(beside + 3 * ((y + 64) * (W + 64) + 64), pixels + 3 * y * W, 3 * W);
    }
    const kg_frame part = {.data = beside,
                           .bytes = 3 * (W + 64) * (H + 64),
                           .stride = 3 * (W + 64),
                           .format = KG_FORMAT_RGB8,
                           .width = W + 64,
                           .height = H + 64,
                           .window = {64, 64, W, H}};
    EXPECT(KG_OK, kg_detector_detect(d, model, &part, NULL, NULL));
    EXPECT(KG_OK, kg_detector_detections(d, found, 4, &count));
    HOLDS(count == 1 && found[0].outline[0][0] - first.outline[0][0] > 63.9f && found[0].outline[0][0] - first.outline[0][0] < 64.1f);
    free(beside);

    /* Digests do not depend on who asks for them. */
    uint32_t one[KG_STAGES], two[KG_STAGES];
    EXPECT(KG_ERROR_NULL, kg_detector_detect_with_digests(d, model, &frame, NULL, NULL, NULL));
    EXPECT(KG_OK, kg_detector_detect_with_digests(d, model, &frame, NULL, NULL, one));
    EXPECT(KG_OK, kg_detector_detect_with_digests(d, model, &frame, NULL, NULL, two));
    HOLDS(memcmp(one, two, sizeof one) == 0 && one[0] != one[1]);

    /* Pose. */
    kg_object object;
    kg_plane_pose pose;
    EXPECT(KG_OK, kg_model_object(model, 0, &object));
    kg_intrinsics camera = {600, 600, 255.5f, 255.5f};
    EXPECT(KG_OK, kg_detection_pose(&first, &object, &camera, 200, &pose));
    const float z = pose.best.translation_mm[2]; /* 200 mm are 512 px at 600 px focal length */
    HOLDS(z > 230 && z < 239 && pose.best.error_px < 1);
    EXPECT(KG_ERROR_SIZE, kg_detection_pose(&first, &object, &camera, 0, &pose));
    camera.fx = -1;
    EXPECT(KG_ERROR_INTRINSICS, kg_detection_pose(&first, &object, &camera, 200, &pose));
    camera.fx = 600;
    kg_detection wrong = first;
    memset(wrong.homography, 0, sizeof wrong.homography);
    EXPECT(KG_ERROR_NO_POSE, kg_detection_pose(&wrong, &object, &camera, 200, &pose));
    EXPECT(KG_ERROR_NULL, kg_detection_pose(NULL, &object, &camera, 200, &pose));
    EXPECT(KG_ERROR_NULL, kg_detection_pose(&first, NULL, &camera, 200, &pose));
    EXPECT(KG_ERROR_NULL, kg_detection_pose(&first, &object, NULL, 200, &pose));
    EXPECT(KG_ERROR_NULL, kg_detection_pose(&first, &object, &camera, 200, NULL));

    /* The tracker. */
    unsigned char *tm = memory(KG_TRACKER_BYTES + 1);
    kg_tracker *t = NULL;
    EXPECT(KG_ERROR_NULL, kg_tracker_init(NULL, KG_TRACKER_BYTES, &t));
    EXPECT(KG_ERROR_NULL, kg_tracker_init(tm, KG_TRACKER_BYTES, NULL));
    EXPECT(KG_ERROR_MEMORY, kg_tracker_init(tm, KG_TRACKER_BYTES - 1, &t));
    EXPECT(KG_ERROR_ALIGNMENT, kg_tracker_init(tm + 1, KG_TRACKER_BYTES, &t));
    EXPECT(KG_OK, kg_tracker_init(tm, KG_TRACKER_BYTES, &t));
    EXPECT(KG_ERROR_HANDLE, kg_tracker_track((kg_tracker *)m, d, model, &frame, NULL, NULL));
    EXPECT(KG_ERROR_HANDLE, kg_tracker_track(t, (kg_detector *)tm, model, &frame, NULL, NULL));
    EXPECT(KG_ERROR_NULL, kg_tracker_track(t, d, NULL, &frame, NULL, NULL));
    kg_track tracks[2];
    for (uint32_t i = 0; i < 3; i++) {
        EXPECT(KG_OK, kg_tracker_track(t, d, model, &frame, NULL, NULL));
        EXPECT(KG_OK, kg_tracker_tracks(t, tracks, 2, &count));
        HOLDS(count == 1 && tracks[0].id == 0 && tracks[0].unseen == 0);
        HOLDS(tracks[0].state == (i == 0 ? KG_TRACK_FOUND : KG_TRACK_TRACKED));
        EXPECT(KG_OK, kg_tracker_stats(t, &stats));
        HOLDS(stats.searched == (i == 0));
    }
    EXPECT(KG_OK, kg_tracker_search_next(t));
    EXPECT(KG_OK, kg_tracker_track(t, d, model, &frame, NULL, NULL));
    EXPECT(KG_OK, kg_tracker_stats(t, &stats));
    HOLDS(stats.searched == 1);
    kg_frame window = frame;
    window.window = (kg_window){0, 0, W, H - 16};
    EXPECT(KG_OK, kg_tracker_track(t, d, model, &window, NULL, NULL));
    EXPECT(KG_OK, kg_tracker_tracks(t, tracks, 2, &count));
    HOLDS(count == 1 && tracks[0].id == 1); /* another window: the track is a new one */
    EXPECT(KG_OK, kg_tracker_reset(t));
    EXPECT(KG_OK, kg_tracker_tracks(t, tracks, 2, &count));
    HOLDS(count == 0);
    EXPECT(KG_ERROR_NULL, kg_tracker_reset(NULL));
    EXPECT(KG_ERROR_NULL, kg_tracker_search_next(NULL));
    EXPECT(KG_ERROR_NULL, kg_tracker_stats(t, NULL));
    free(tm);
    free(m);
}

int main(int argc, char **argv) {
    if (argc != 2) {
        return 2;
    }
    unsigned char *pixels = read_picture(argv[1]);
    texts_and_names();
    frames();
    size_t bytes = 0;
    unsigned char *model_bytes = train(pixels, &bytes);
    models(model_bytes, bytes);
    kg_model model;
    EXPECT(KG_OK, kg_model_open(&model, model_bytes, bytes));
    detectors(&model, pixels);
    free(model_bytes);
    free(pixels);
    printf("%d checks, %d failures\n", checks, failures);
    return failures > 0;
}
