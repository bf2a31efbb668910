/* Keygraph: finds planar objects in camera frames from one picture of each. MIT licence.

   This file is made of bindings/c by cbindgen: change it there.

   Memory. The library has no heap and no threads, and needs memcpy, memmove, memset and memcmp. The
   caller gives memory for each object, KG_..._BYTES bytes at a multiple of KG_ALIGNMENT, in any RAM:
   KG_MEMORY(name, bytes) declares it. An object stays where it was made and needs no end. What it
   refers to (the bytes of a model, the detector of a tracker's call) is named beside each function.

   Pointers. NULL, wrong alignment, memory that is too short, and lengths that no memory has are found
   and give a status. A pointer that leads elsewhere cannot be found. Outputs need not be initialised.

   Errors. Every function that can fail returns a kg_status: below zero it is an error, and
   kg_status_text() says what to do. Numbers that name something (formats, profiles) are checked.

   Threads and interrupts. An object is used by one of them at a time. Different objects may be used at
   once; models that are open may be used by all. A call that finds its object at work returns
   KG_ERROR_BUSY; that is a net, not a lock.

   Coordinates are px, x to the right and y down; pixel centres lie at integers. */


#ifndef KEYGRAPH_H
#define KEYGRAPH_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define KG_ALIGNAS(n) alignas(n)
#define KG_ASSERT(condition, text) static_assert(condition, text)
#else
#define KG_ALIGNAS(n) _Alignas(n)
#define KG_ASSERT(condition, text) _Static_assert(condition, text)
#endif

/* Declares memory for an object: KG_MEMORY(memory, KG_QVGA_DETECTOR_BYTES); */
#define KG_MEMORY(name, bytes) KG_ALIGNAS(8) static unsigned char name[bytes]

/**
 * Alignment of the memory that is given for an object, bytes.
 */
#define KG_ALIGNMENT 8

/**
 * Version of the interface that the header describes. It changes when a program that was compiled
 * with another header cannot use the library.
 */
#define KG_ABI_VERSION 1

/**
 * Bytes of a name with its zero byte.
 */
#define KG_NAME_BYTES 33

/**
 * Number of stages of a search.
 */
#define KG_STAGES 11

/**
 * Number of buffers of a detector that grow with its profile.
 */
#define KG_BUFFERS 12

/**
 * Columns of the grid of a surface, and rows.
 */
#define KG_SURFACE_SIDE 9

/**
 * Bytes of a detector of the profile qqvga.
 */
#define KG_QQVGA_DETECTOR_BYTES 123328

/**
 * Bytes of a detector of the profile qvga.
 */
#define KG_QVGA_DETECTOR_BYTES 329984

/**
 * Bytes of a detector of the profile vga.
 */
#define KG_VGA_DETECTOR_BYTES 1189376

/**
 * Bytes of a detector of the profile hd.
 */
#define KG_HD_DETECTOR_BYTES 2982464

/**
 * Most detections in a frame. An array of that many holds every result.
 */
#define KG_DETECTIONS 64

/**
 * Threshold that is used where no options are given.
 */
#define KG_DEFAULT_THRESHOLD 0.8

/**
 * Bytes of a tracker.
 */
#define KG_TRACKER_BYTES 15296

/**
 * Most tracks. An array of that many holds every result.
 */
#define KG_TRACKS 64

/**
 * Bytes of a trainer for pictures of up to 160 x 120 px.
 */
#define KG_QQVGA_TRAINER_BYTES 139072

/**
 * Bytes of a trainer for pictures of up to 320 x 240 px.
 */
#define KG_QVGA_TRAINER_BYTES 383936

/**
 * Bytes of a trainer for pictures of up to 640 x 480 px.
 */
#define KG_VGA_TRAINER_BYTES 1330752

/**
 * Result of a call. Zero and above: the call did its work. Below zero: it did nothing, and outputs keep
 * what they held, unless the function says otherwise.
 */
enum kg_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * All is well.
     */
    KG_OK = 0,
    /**
     * The observer, or its budget, has stopped the search. What was found until then are the results.
     */
    KG_STOPPED = 1,
    /**
     * The search in pieces goes on: call kg_detector_step() again.
     */
    KG_MORE = 2,
    /**
     * A pointer is NULL that must not be.
     */
    KG_ERROR_NULL = -1,
    /**
     * A pointer is not aligned: to KG_ALIGNMENT for the memory of an object, else to its type.
     */
    KG_ERROR_ALIGNMENT = -2,
    /**
     * The memory is shorter than the header says: give KG_..._BYTES.
     */
    KG_ERROR_MEMORY = -3,
    /**
     * A length leads around the end of the address space.
     */
    KG_ERROR_LENGTH = -4,
    /**
     * The memory holds no object of this kind: call its init or open function first.
     */
    KG_ERROR_HANDLE = -5,
    /**
     * The object is at work: it was called from a callback, from an interrupt or a second thread; or
     * a search in pieces is not at its end: finish it, or call kg_detector_cancel().
     */
    KG_ERROR_BUSY = -6,
    /**
     * There is no such profile.
     */
    KG_ERROR_PROFILE = -7,
    /**
     * There is no such pixel format.
     */
    KG_ERROR_FORMAT = -8,
    /**
     * An option is out of its range.
     */
    KG_ERROR_OPTION = -9,
    /**
     * There is no element with this index.
     */
    KG_ERROR_INDEX = -10,
    /**
     * A name is not UTF-8, is empty, or has more than KG_NAME_BYTES - 1 bytes.
     */
    KG_ERROR_NAME = -11,
    /**
     * There is no such preset.
     */
    KG_ERROR_PRESET = -12,
    /**
     * No search has begun: call kg_detector_begin() first.
     */
    KG_ERROR_NO_SEARCH = -13,
    /**
     * The buffer does not hold exactly one frame, or with a stride at least one: kg_frame_bytes() says
     * how many bytes that is.
     */
    KG_ERROR_FRAME_LENGTH = -20,
    /**
     * The width is odd, and the format shares chroma between columns.
     */
    KG_ERROR_ODD_WIDTH = -21,
    /**
     * The height is odd, and the format shares chroma between rows.
     */
    KG_ERROR_ODD_HEIGHT = -22,
    /**
     * A side of the frame or of the window has less than 16 px.
     */
    KG_ERROR_TOO_SMALL = -23,
    /**
     * The frame, or its window, does not fit the profile: scale it down, or use a larger profile.
     */
    KG_ERROR_TOO_LARGE = -24,
    /**
     * The stride is shorter than a row, or odd in I420.
     */
    KG_ERROR_STRIDE = -25,
    /**
     * The window leaves the frame.
     */
    KG_ERROR_WINDOW = -26,
    /**
     * The window begins between pixels that share chroma: begin at an even x, in NV12 and I420 at an
     * even y too.
     */
    KG_ERROR_WINDOW_ODD = -27,
    /**
     * The bytes do not begin as a model does.
     */
    KG_ERROR_NOT_A_MODEL = -40,
    /**
     * A newer version wrote the model: update the library, or train again.
     */
    KG_ERROR_NEWER_MODEL = -41,
    /**
     * An older version wrote the model: train again.
     */
    KG_ERROR_OLDER_MODEL = -42,
    /**
     * The bytes end before the model does.
     */
    KG_ERROR_TRUNCATED = -43,
    /**
     * Bytes follow the model: kg_model_bytes() says how many it has.
     */
    KG_ERROR_TRAILING = -44,
    /**
     * The checksum does not match: the model is damaged.
     */
    KG_ERROR_CHECKSUM = -45,
    /**
     * The checksum matches, and the content contradicts itself: train again.
     */
    KG_ERROR_INCONSISTENT = -46,
    /**
     * The buffer for the model cannot hold even an empty one.
     */
    KG_ERROR_BUFFER = -60,
    /**
     * The picture has too few corners: use one with more texture, sharper or brighter.
     */
    KG_ERROR_NO_TEXTURE = -61,
    /**
     * A side of the picture is too short: use a larger picture.
     */
    KG_ERROR_TOO_NARROW = -62,
    /**
     * A side of the original picture is not from 1 to 1,048,576 px.
     */
    KG_ERROR_ORIGINAL = -63,
    /**
     * Intrinsics are four finite numbers, the focal lengths above zero.
     */
    KG_ERROR_INTRINSICS = -80,
    /**
     * A size is not above zero, or not finite.
     */
    KG_ERROR_SIZE = -81,
    /**
     * No pose has this homography: it shows the plane from behind or edge on.
     */
    KG_ERROR_NO_POSE = -82,
    /**
     * The core reports an error that this interface does not know.
     */
    KG_ERROR_UNKNOWN = -99,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum kg_status kg_status;
#else
typedef int32_t kg_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A detector, in the memory that was given to kg_detector_init(). It needs no end: the memory may be
 * used for anything else when it is not needed any more. It must not be moved.
 */
typedef struct kg_detector kg_detector;

/**
 * A tracker, in the memory that was given to kg_tracker_init(). It needs no end, and must not be moved.
 */
typedef struct kg_tracker kg_tracker;

/**
 * A trainer, in the memory that was given to kg_trainer_init(). It needs no end, and must not be moved.
 * After training, the memory may hold a detector instead.
 */
typedef struct kg_trainer kg_trainer;

/**
 * Function that is told of a panic: the source file, the number of bytes of its name, which no zero
 * byte ends, and the line. It may log, and reset the device; if it returns, the program ends.
 */
typedef void (*kg_panic_handler)(const char *file, size_t file_bytes, uint32_t line);

/**
 * Layout of the pixels of a frame in memory: one of KG_FORMAT_...
 */
typedef uint32_t kg_format;

/**
 * A model that has been checked. What is in it is the library's. It may be copied, and needs no end.
 * It refers to the bytes of the model, which must stay where and as they are for as long as it is used.
 */
typedef struct kg_model {
    uint64_t opaque[24];
} kg_model;

/**
 * What is known of a model.
 */
typedef struct kg_model_info {
    /**
     * Number of bytes.
     */
    size_t bytes;
    /**
     * Number of objects, 1 to 65,535.
     */
    uint32_t objects;
    /**
     * Number of views, over all objects.
     */
    uint32_t views;
    /**
     * Number of keypoints, over all views.
     */
    uint32_t keypoints;
    /**
     * Number of keygraphs. A keygraph that is also on a list of the likeliest counts twice.
     */
    uint32_t keygraphs;
    /**
     * 1 if the model was trained with the preset "paper", 0 if with any other. A model does not say
     * which of the others it was.
     */
    uint32_t paper;
    /**
     * 1 if the model uses colour: it then finds more in frames that have some.
     */
    uint32_t colour;
} kg_model_info;

/**
 * An object of a model.
 */
typedef struct kg_object {
    /**
     * Name, UTF-8; it ends with a zero byte.
     */
    char name[KG_NAME_BYTES];
    /**
     * Width of the training picture, px. Homographies map from px of that picture.
     */
    uint32_t width;
    /**
     * Height of the training picture, px.
     */
    uint32_t height;
    /**
     * Number of keypoints, over all views.
     */
    uint32_t keypoints;
} kg_object;

/**
 * Size of the frames that a detector takes: one of KG_PROFILE_...
 */
typedef uint32_t kg_profile;

/**
 * A rectangular part of a frame, px. All zero stands for the whole frame.
 */
typedef struct kg_window {
    /**
     * Leftmost column.
     */
    uint32_t x;
    /**
     * Topmost row.
     */
    uint32_t y;
    /**
     * Number of columns.
     */
    uint32_t width;
    /**
     * Number of rows.
     */
    uint32_t height;
} kg_window;

/**
 * One frame as the camera gave it. The bytes are read during the call alone.
 */
typedef struct kg_frame {
    /**
     * The first byte of the first row. It needs no alignment.
     */
    const uint8_t *data;
    /**
     * Number of bytes at `data`. Without a stride: exactly those of a frame. With one: at least.
     */
    size_t bytes;
    /**
     * Number of bytes from a row to the next, for rows with bytes between them; 0 for rows without.
     * In NV12 and I420 it is the stride of luma, and the chroma planes follow after `stride * height`
     * bytes: with this stride in NV12, with half of it in I420.
     */
    size_t stride;
    /**
     * Pixel format: KG_FORMAT_...
     */
    kg_format format;
    /**
     * Width, px: 16 to 32,767, and no more than the profile takes.
     */
    uint32_t width;
    /**
     * Height, px.
     */
    uint32_t height;
    /**
     * The part that is used; all zero for the whole frame. Results are in px of the whole frame. Only
     * the part must fit the profile.
     */
    struct kg_window window;
} kg_frame;

/**
 * How much of a frame is searched: one of KG_DEPTH_...
 */
typedef uint32_t kg_depth;

/**
 * What a search looks for. NULL in place of it stands for KG_DEFAULT_THRESHOLD, 0, KG_DEPTH_USUAL.
 */
typedef struct kg_options {
    /**
     * Minimum score of a detection, 0 to 1. A tracker needs it for what appears.
     */
    float threshold;
    /**
     * Minimum share of an object that must be seen, 0 to 1; 0 leaves that to the score.
     */
    float min_visible;
    /**
     * KG_DEPTH_...
     */
    kg_depth depth;
} kg_options;

/**
 * Returns the ticks of a clock that counts up. A clock of 32 bits may start again at 0.
 */
typedef uint64_t (*kg_clock)(void *context);

/**
 * Returns not 0 if the search goes on, 0 to stop it. It is asked every 200,000 instructions or more
 * often, so that others can be given their turn too. After it has returned 0 it is not asked again.
 */
typedef int32_t (*kg_goes_on)(void *context);

/**
 * Watches a search. Every member may be 0. The functions must return: no longjmp, no C++ exception.
 * They must not use the detector or the tracker that is at work; such calls return KG_ERROR_BUSY.
 */
typedef struct kg_observer {
    /**
     * Passed to the functions.
     */
    void *context;
    /**
     * Clock; without it, ticks are 0.
     */
    kg_clock now;
    /**
     * Question whether the search goes on.
     */
    kg_goes_on goes_on;
    /**
     * Number of ticks after which the search is stopped, from the call that begins it on; 0: it has all
     * the time. It needs a clock. Only the conversion of the frame is never cut short.
     */
    uint64_t budget;
} kg_observer;

/**
 * One instance of an object in a frame.
 */
typedef struct kg_detection {
    /**
     * Index of the object in the model.
     */
    uint32_t object;
    /**
     * Estimated probability that the detection is right, 0 to 1.
     */
    float score;
    /**
     * Map from px of the training picture to px of the frame, row-major; the last element is 1.
     */
    float homography[9];
    /**
     * Corners of the picture, (0,0) (w,0) (w,h) (0,h), in the frame: x and y, px.
     */
    float outline[4][2];
    /**
     * Share of the object that is seen and agrees, 0 to 1. What lies outside the frame does not count.
     */
    float visible;
    /**
     * Number of keygraphs of which all three vertices agree with the pose.
     */
    uint32_t votes;
    /**
     * Number of distinct corners of the frame that agree with the pose.
     */
    uint32_t agreeing;
    /**
     * Number of other objects that could be at this place, kg_detector_rivals(). 0 in tracks and while
     * a search in pieces goes on.
     */
    uint32_t rivals;
} kg_detection;

/**
 * A pinhole camera without distortion, in px of the frame. Pixel centres lie at integers, as in OpenCV.
 */
typedef struct kg_intrinsics {
    /**
     * Focal length along x, px.
     */
    float fx;
    /**
     * Focal length along y, px.
     */
    float fy;
    /**
     * Principal point, x, px.
     */
    float cx;
    /**
     * Principal point, y, px.
     */
    float cy;
} kg_intrinsics;

/**
 * A camera with a lens.
 */
typedef struct kg_lens {
    /**
     * Focal lengths and principal point, px of the frame.
     */
    struct kg_intrinsics intrinsics;
    /**
     * 1 when the coefficients are those of a fisheye lens (k1 k2 k3 k4, then zeros), 0 when they are those of Brown and
     * Conrady, in OpenCV's order (k1 k2 p1 p2 k3 k4 k5 k6).
     */
    uint32_t fisheye;
    /**
     * Coefficients.
     */
    float distortion[8];
} kg_lens;

/**
 * Where the picture of an object lies in a frame, on a plane or on a surface that is bent.
 */
typedef struct kg_surface {
    /**
     * 1 when the surface is bent, 0 when a plane explains what is seen.
     */
    uint32_t bent;
    /**
     * Map from px of the training picture to px of the ideal frame, whose straight lines are straight, row-major;
     * the last element is 1. Without a lens that is the frame. Of a bent surface it is that of the plane of its mean
     * direction through the middle of the picture.
     */
    float homography[9];
    /**
     * Places in the frame of a grid of points of the picture: x and y, px, row by row from the picture's
     * top left corner to its bottom right corner.
     */
    float points[KG_SURFACE_SIDE][KG_SURFACE_SIDE][2];
} kg_surface;

/**
 * What one stage did in one frame.
 */
typedef struct kg_stage {
    /**
     * Ticks of the observer's clock.
     */
    uint64_t ticks;
    /**
     * Number of candidates that came in.
     */
    uint32_t seen;
    /**
     * Number of results that were passed on.
     */
    uint32_t kept;
    /**
     * Number of results that were lost to a full buffer. A full buffer is no error.
     */
    uint32_t dropped;
    /**
     * 0.
     */
    uint32_t reserved;
} kg_stage;

/**
 * What the stages did in one frame.
 */
typedef struct kg_stats {
    /**
     * The stages in their order; kg_stage_name() has their names.
     */
    struct kg_stage stages[KG_STAGES];
    /**
     * Number of times that a tile of the frame was searched.
     */
    uint32_t tiles;
    /**
     * 1 if the search was stopped before its end.
     */
    uint32_t stopped;
    /**
     * 1 if the frame was searched, 0 if a tracker only followed what it knew.
     */
    uint32_t searched;
    /**
     * 0.
     */
    uint32_t reserved;
} kg_stats;

/**
 * One buffer of a detector.
 */
typedef struct kg_buffer {
    /**
     * Size, bytes.
     */
    size_t bytes;
    /**
     * Maximum number of elements.
     */
    size_t capacity;
    /**
     * Most elements that it held in the last frame.
     */
    size_t most;
} kg_buffer;

/**
 * State of a track: one of KG_TRACK_...
 */
typedef uint32_t kg_track_state;

/**
 * An instance that is followed.
 */
typedef struct kg_track {
    /**
     * Id of the instance. No other one of the tracker gets it, unless 2^32 have been given.
     */
    uint32_t id;
    /**
     * KG_TRACK_FOUND, KG_TRACK_TRACKED or KG_TRACK_LOST.
     */
    kg_track_state state;
    /**
     * Number of frames since the instance was seen; 0 when it is seen in this one.
     */
    uint32_t unseen;
    /**
     * Detection in this frame, or the last one.
     */
    struct kg_detection detection;
} kg_track;

/**
 * How much a model holds: one of KG_PRESET_...
 */
typedef uint32_t kg_preset;

/**
 * What is trained.
 */
typedef struct kg_training {
    /**
     * Name of the object: UTF-8 of 1 to KG_NAME_BYTES - 1 bytes, and a zero byte.
     */
    const char *name;
    /**
     * KG_PRESET_...
     */
    kg_preset preset;
    /**
     * Not 0 to leave out colour, for pictures and cameras without it.
     */
    uint32_t luma_only;
    /**
     * Width of the picture that the given one is a scaled copy of, px; poses are in px of it. 0 in both
     * members: the given picture, or the window of it.
     */
    uint32_t original_width;
    /**
     * Height of that picture, px.
     */
    uint32_t original_height;
} kg_training;

/**
 * Result of a training.
 */
typedef struct kg_trained {
    /**
     * Length of the model, at the start of the buffer, bytes.
     */
    size_t bytes;
    /**
     * Number of keypoints, over all views.
     */
    uint32_t keypoints;
    /**
     * Number of keygraphs in the model.
     */
    uint32_t keygraphs;
    /**
     * Number of keygraphs that exceeded a maximum or the buffer.
     */
    uint32_t dropped;
} kg_trained;

/**
 * A rigid motion from object to camera coordinates: rotation * p + translation. Both have x to the
 * right, y down and z away from the viewer; the object's origin is the middle of its picture.
 */
typedef struct kg_pose {
    /**
     * Rotation matrix, row-major.
     */
    float rotation[9];
    /**
     * The middle of the picture in camera coordinates, mm.
     */
    float translation_mm[3];
    /**
     * Distance between the points of the homography and those of the pose, px: root mean square.
     */
    float error_px;
} kg_pose;

/**
 * The two poses that a plane may have.
 */
typedef struct kg_plane_pose {
    /**
     * The pose that fits better.
     */
    struct kg_pose best;
    /**
     * The pose whose tilt is mirrored about the line of sight.
     */
    struct kg_pose mirrored;
    /**
     * 1 if the mirrored pose fits almost as well: take the tilt from elsewhere. Distance, place and the
     * turn within the plane hold in both.
     */
    uint32_t ambiguous;
} kg_plane_pose;

/**
 * 3 bytes a pixel: red, green, blue.
 */
#define KG_FORMAT_RGB8 0

/**
 * 1 byte a pixel.
 */
#define KG_FORMAT_GRAY8 1

/**
 * 4:2:2 packed, Y0 U Y1 V, 2 bytes a pixel. The width must be even.
 */
#define KG_FORMAT_YUYV 2

/**
 * 4:2:0, a Y plane, then interleaved U and V of half size. Both sides must be even.
 */
#define KG_FORMAT_NV12 3

/**
 * 4:2:0, a Y plane, then a U plane and a V plane of half size. Both sides must be even.
 */
#define KG_FORMAT_I420 4

/**
 * 2 bytes a pixel, little endian, red in the top five bits.
 */
#define KG_FORMAT_RGB565 5

/**
 * 4:2:2 packed, U Y0 V Y1, 2 bytes a pixel. The width must be even.
 */
#define KG_FORMAT_UYVY 6

/**
 * 2 bytes a pixel, big endian, red in the top five bits: as many sensors send their bytes.
 */
#define KG_FORMAT_RGB565_BE 7

/**
 * Frames of up to 160 x 120 px.
 */
#define KG_PROFILE_QQVGA 0

/**
 * Frames of up to 320 x 240 px.
 */
#define KG_PROFILE_QVGA 1

/**
 * Frames of up to 640 x 480 px.
 */
#define KG_PROFILE_VGA 2

/**
 * Frames of up to 1280 x 720 px.
 */
#define KG_PROFILE_HD 3

/**
 * The search stops when nothing is in doubt. Where two objects are found, small ones are searched for
 * in nine parts of the frame too.
 */
#define KG_DEPTH_USUAL 0

/**
 * As usual, but never in parts: the hardest frame takes about twice as long as an ordinary one.
 */
#define KG_DEPTH_ONCE 1

/**
 * All of the frame is searched for all of the model, in every case.
 */
#define KG_DEPTH_THOROUGH 2

/**
 * A search found the instance; it was not seen in the frame before.
 */
#define KG_TRACK_FOUND 0

/**
 * The instance was seen in the frame before, and in this one.
 */
#define KG_TRACK_TRACKED 1

/**
 * The instance is not seen. Its detection is the last one that it had.
 */
#define KG_TRACK_LOST 2

/**
 * Up to 2,000,000 bytes. A larger model finds no more.
 */
#define KG_PRESET_LARGE 0

/**
 * Up to 1,500,000 bytes: fits the flash of the larger boards.
 */
#define KG_PRESET_STANDARD 1

/**
 * Up to 524,288 bytes: fits most boards.
 */
#define KG_PRESET_COMPACT 2

/**
 * Up to 65,536 bytes, from a picture of at most 240 x 180 px: the preset for training on a board.
 */
#define KG_PRESET_LEARNT 3

/**
 * The method of the paper as written, up to 8,388,608 bytes.
 */
#define KG_PRESET_PAPER 4

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Sets the function that is told of a panic, or none with NULL.
 *
 * The library panics only if it has a defect, or if its memory has been overwritten. It then ends
 * the program: by an undefined instruction, which a debugger and the fault handler of a board see.
 * Nothing is unwound, and no call returns.
 */
void kg_set_panic_handler(kg_panic_handler handler);

/**
 * Returns a sentence that says what a status means and what to do. It is English, ends with a zero
 * byte, and is never NULL. Any number may be passed.
 */
const char *kg_status_text(int32_t status);

/**
 * Returns the version of the interface that the library was built with. A program that loads the
 * library at run time compares it with KG_ABI_VERSION first.
 */
uint32_t kg_abi_version(void);

/**
 * Returns the version of the library as a text, three numbers with dots between them. It ends
 * with a zero byte and is never NULL.
 */
const char *kg_version_text(void);

/**
 * Tells how many bytes a frame of this format, size and stride has (`stride` 0: rows without bytes
 * between them; with one: the bytes up to the end of the last row).
 *
 * Returns KG_OK, or the error that kg_detector_detect() would return for such a frame.
 */
kg_status kg_frame_bytes(kg_format format, uint32_t width, uint32_t height, size_t stride, size_t *bytes);

/**
 * Checks that `bytes` bytes at `data` are exactly one model, and opens it. `data` needs no alignment.
 * It takes one pass over the bytes; nothing is copied.
 *
 * A model that is refused leaves `model` without one.
 *
 * Errors: KG_ERROR_NOT_A_MODEL to KG_ERROR_INCONSISTENT, KG_ERROR_NULL, KG_ERROR_ALIGNMENT of `model`,
 * KG_ERROR_LENGTH.
 */
kg_status kg_model_open(struct kg_model *model, const uint8_t *data, size_t bytes);

/**
 * Tells how many bytes a model has that begins at `data`, from its header, where more bytes may
 * follow: a partition of flash of `available` bytes. kg_model_open() then takes that many.
 *
 * Errors: KG_ERROR_NOT_A_MODEL, KG_ERROR_NEWER_MODEL, KG_ERROR_OLDER_MODEL, KG_ERROR_TRUNCATED if the
 * model has more bytes than `available`, KG_ERROR_NULL, KG_ERROR_LENGTH.
 */
kg_status kg_model_bytes(const uint8_t *data, size_t available, size_t *length);

/**
 * Tells what is known of an opened model.
 *
 * Errors: KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_model_describe(const struct kg_model *model, struct kg_model_info *info);

/**
 * Tells name and size of an object of a model: `index` from 0 to kg_model_info.objects - 1.
 *
 * Errors: KG_ERROR_INDEX, KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_model_object(const struct kg_model *model, uint32_t index, struct kg_object *object);

/**
 * Returns the name of a stage, `index` from 0 to KG_STAGES - 1, or NULL. It ends with a zero byte.
 */
const char *kg_stage_name(uint32_t index);

/**
 * Returns the name of a buffer, `index` from 0 to KG_BUFFERS - 1, or NULL. It ends with a zero byte.
 */
const char *kg_buffer_name(uint32_t index);

/**
 * Makes a detector in memory of at least KG_..._DETECTOR_BYTES bytes of its profile, at a multiple of
 * KG_ALIGNMENT. The memory need not be cleared. `detector` receives the detector, which is at the
 * start of the memory. It takes a memset, and next to no stack.
 *
 * Errors: KG_ERROR_PROFILE, KG_ERROR_MEMORY, KG_ERROR_ALIGNMENT, KG_ERROR_NULL, KG_ERROR_LENGTH.
 */
kg_status kg_detector_init(void *memory, size_t bytes, kg_profile profile, struct kg_detector **detector);

/**
 * Tells how many bytes a detector of a profile takes: the constants of the header, for programs that
 * load the library at run time.
 *
 * Errors: KG_ERROR_PROFILE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detector_bytes(kg_profile profile, size_t *bytes);

/**
 * Searches a frame for the objects of a model. kg_detector_detections() then gives the results.
 * `options` and `observer` may be NULL. A search in pieces that is not at its end is given up.
 *
 * Returns KG_OK, KG_STOPPED, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_OPTION, KG_ERROR_FORMAT,
 * KG_ERROR_FRAME_LENGTH to KG_ERROR_WINDOW_ODD, KG_ERROR_NULL, KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
 * After KG_ERROR_TOO_LARGE there are no results; after the other errors those of before.
 */
kg_status kg_detector_detect(struct kg_detector *detector,
                             const struct kg_model *model,
                             const struct kg_frame *frame,
                             const struct kg_options *options,
                             const struct kg_observer *observer);

/**
 * Does what kg_detector_detect() does, and writes a digest of what each stage made into `digests`, an
 * array of KG_STAGES numbers. Two machines whose digests agree made the same, bit for bit. It takes
 * some more time, which is counted for no stage.
 */
kg_status kg_detector_detect_with_digests(struct kg_detector *detector,
                                          const struct kg_model *model,
                                          const struct kg_frame *frame,
                                          const struct kg_options *options,
                                          const struct kg_observer *observer,
                                          uint32_t *digests);

/**
 * Begins a search in pieces, for a program that must do something else in between. The frame is read
 * here, and its buffer may be used again; the bytes of the model must stay. The rest is as in
 * kg_detector_detect().
 *
 * Returns KG_MORE, or an error.
 */
kg_status kg_detector_begin(struct kg_detector *detector,
                            const struct kg_model *model,
                            const struct kg_frame *frame,
                            const struct kg_options *options,
                            const struct kg_observer *observer);

/**
 * Begins to search the frame that was read last for the objects of another model, such as one that lies
 * elsewhere in flash: the frame's buffer may hold the next frame by now, and models need not be
 * merged. What was found so far is given up: take it before. A detector that has read no frame finds
 * nothing. The rest is as in kg_detector_begin().
 *
 * Returns KG_MORE, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_OPTION, KG_ERROR_FORMAT, KG_ERROR_NULL,
 * KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
 */
kg_status kg_detector_begin_again(struct kg_detector *detector,
                                  const struct kg_model *model,
                                  const struct kg_options *options,
                                  const struct kg_observer *observer);

/**
 * Does the next piece of a search. The longest one finds the corners and triangles of the finest
 * level. The budget of the observer counts from kg_detector_begin() on.
 *
 * Returns KG_MORE, KG_OK after the last piece, KG_STOPPED if the observer has stopped the search, or
 * KG_ERROR_NO_SEARCH, KG_ERROR_BUSY, KG_ERROR_HANDLE, KG_ERROR_OPTION, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detector_step(struct kg_detector *detector, const struct kg_observer *observer);

/**
 * Gives up a search in pieces. There are no results then. Without a search it does nothing.
 *
 * Returns KG_OK, or KG_ERROR_BUSY, KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detector_cancel(struct kg_detector *detector);

/**
 * Writes the detections of the last search into `out`, an array of `room` elements, best score first,
 * and how many there are into `count`, which may be more. KG_DETECTIONS is always enough. Between two
 * steps of a search in pieces, these are the detections so far.
 *
 * Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
 */
kg_status kg_detector_detections(struct kg_detector *detector,
                                 struct kg_detection *out,
                                 size_t room,
                                 size_t *count);

/**
 * Writes the rivals of a detection into `out`: other objects that could be at its place, and are seen
 * less well there. `index` is that of the detection among the results. The rest is as in
 * kg_detector_detections().
 *
 * Returns KG_OK, or KG_ERROR_INDEX, KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT,
 * KG_ERROR_LENGTH.
 */
kg_status kg_detector_rivals(struct kg_detector *detector,
                             size_t index,
                             struct kg_detection *out,
                             size_t room,
                             size_t *count);

/**
 * Writes the surface on which the object of a detection lies into `out`: that of a label on a can or of a page of
 * a book where a plane does not explain what is seen, else the plane. `model` is the one that was searched for,
 * `index` that of the detection among the results. `lens` is the camera's, px of the frame, and may be NULL; through
 * one a plane has curved sides. A bent surface takes about as long as the search of a frame that shows an object, and
 * some 14 KB of stack.
 *
 * Returns KG_OK, or KG_ERROR_INDEX, KG_ERROR_INTRINSICS, KG_ERROR_OPTION, KG_ERROR_HANDLE, KG_ERROR_BUSY,
 * KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detector_surface(struct kg_detector *detector,
                              const struct kg_model *model,
                              size_t index,
                              const struct kg_lens *lens,
                              struct kg_surface *out);

/**
 * Tells what the stages did in the last frame.
 *
 * Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY (also between two steps of a search in pieces),
 * KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detector_stats(struct kg_detector *detector, struct kg_stats *stats);

/**
 * Tells size and use of a buffer of the detector: `index` from 0 to KG_BUFFERS - 1.
 *
 * Returns KG_OK, or KG_ERROR_INDEX, KG_ERROR_HANDLE, KG_ERROR_BUSY (also between two steps of a search
 * in pieces), KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detector_buffer(struct kg_detector *detector, uint32_t index, struct kg_buffer *buffer);

/**
 * Makes a tracker without tracks in memory of at least KG_TRACKER_BYTES bytes, at a multiple of
 * KG_ALIGNMENT. The memory need not be cleared. `tracker` receives the tracker.
 *
 * Errors: KG_ERROR_MEMORY, KG_ERROR_ALIGNMENT, KG_ERROR_NULL, KG_ERROR_LENGTH.
 */
kg_status kg_tracker_init(void *memory, size_t bytes, struct kg_tracker **tracker);

/**
 * Follows the objects of a model in the next frame, and searches the frame where needed: when nothing
 * is in sight, when something is in doubt or lost, and every tenth frame. A frame that shows what the
 * last searched frame showed is not searched again, except one in thirty. kg_tracker_tracks() then
 * gives the results. The tracker works in the buffers of `detector`, whose results are lost.
 *
 * The frames must have one size and one window. With another window all tracks are forgotten.
 * `options` and `observer` may be NULL. When the observer stops a search, the piece that has begun comes to
 * its end; the search goes on in the next frame, unless `detector` was used for something else. What is
 * known is followed all the same.
 *
 * Returns KG_OK, KG_STOPPED, or the errors of kg_detector_detect().
 */
kg_status kg_tracker_track(struct kg_tracker *tracker,
                           struct kg_detector *detector,
                           const struct kg_model *model,
                           const struct kg_frame *frame,
                           const struct kg_options *options,
                           const struct kg_observer *observer);

/**
 * Writes the tracks into `out`, an array of `room` elements, and how many there are into `count`, which
 * may be more: first those that are seen, best score first, then those that are lost. What is not seen
 * for 30 frames is forgotten. KG_TRACKS elements are always enough.
 *
 * Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
 */
kg_status kg_tracker_tracks(struct kg_tracker *tracker, struct kg_track *out, size_t room, size_t *count);

/**
 * Makes the tracker search the next frame, even if everything is in sight.
 *
 * Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_tracker_search_next(struct kg_tracker *tracker);

/**
 * Forgets all tracks. Their ids are not used again.
 *
 * Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_tracker_reset(struct kg_tracker *tracker);

/**
 * Tells what the stages did with the last frame. Following counts as the stage "accept".
 *
 * Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_tracker_stats(struct kg_tracker *tracker, struct kg_stats *stats);

/**
 * Makes a trainer for pictures of a profile (not hd) in memory of at least KG_..._TRAINER_BYTES bytes, at
 * a multiple of KG_ALIGNMENT. The memory need not be cleared. `trainer` receives the trainer.
 *
 * Errors: KG_ERROR_PROFILE, KG_ERROR_MEMORY, KG_ERROR_ALIGNMENT, KG_ERROR_NULL, KG_ERROR_LENGTH.
 */
kg_status kg_trainer_init(void *memory, size_t bytes, kg_profile profile, struct kg_trainer **trainer);

/**
 * Trains a model from one picture: the object from the front, and nothing else; a window of a frame will
 * do. The model is written to the start of `out`, which has `room` bytes and needs no alignment; what the
 * preset allows is never exceeded. `trained` receives its length. kg_model_open() then takes it.
 *
 * A model that has less room than its preset allows holds the likeliest keygraphs. It takes up to some
 * seconds on a board. After an error the content of `out` is not defined.
 *
 * Errors: KG_ERROR_BUFFER to KG_ERROR_ORIGINAL, KG_ERROR_NAME, KG_ERROR_PRESET, KG_ERROR_FORMAT,
 * KG_ERROR_FRAME_LENGTH to KG_ERROR_WINDOW_ODD, KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT,
 * KG_ERROR_LENGTH.
 */
kg_status kg_trainer_train(struct kg_trainer *trainer,
                           const struct kg_frame *picture,
                           const struct kg_training *training,
                           uint8_t *out,
                           size_t room,
                           struct kg_trained *trained);

/**
 * Computes where a detected object is before the camera, if its picture is truly `width_mm` mm wide. Through a lens,
 * put the homography of its kg_surface into the detection first. `object` is that of kg_model_object() for kg_detection.object.
 *
 * Errors: KG_ERROR_INTRINSICS, KG_ERROR_SIZE, KG_ERROR_NO_POSE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
 */
kg_status kg_detection_pose(const struct kg_detection *detection,
                            const struct kg_object *object,
                            const struct kg_intrinsics *intrinsics,
                            float width_mm,
                            struct kg_plane_pose *pose);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* KEYGRAPH_H */

/* The library asserts the same sizes when it is built. */
KG_ASSERT(KG_ALIGNMENT == 8, "KG_MEMORY aligns to 8");
KG_ASSERT(sizeof(size_t) == sizeof(void *), "a length is as wide as a pointer");
KG_ASSERT(sizeof(kg_status) == 4, "kg_status has another size");
KG_ASSERT(sizeof(kg_model) == 192, "kg_model has another size");
KG_ASSERT(sizeof(kg_object) == 48, "kg_object has another size");
KG_ASSERT(sizeof(kg_window) == 16, "kg_window has another size");
KG_ASSERT(sizeof(kg_options) == 12, "kg_options has another size");
KG_ASSERT(sizeof(kg_detection) == 92, "kg_detection has another size");
KG_ASSERT(sizeof(kg_track) == 104, "kg_track has another size");
KG_ASSERT(sizeof(kg_stage) == 24, "kg_stage has another size");
KG_ASSERT(sizeof(kg_stats) == 280, "kg_stats has another size");
KG_ASSERT(sizeof(kg_intrinsics) == 16, "kg_intrinsics has another size");
KG_ASSERT(sizeof(kg_plane_pose) == 108, "kg_plane_pose has another size");
KG_ASSERT(sizeof(kg_frame) == 3 * sizeof(void *) + 28 + (sizeof(void *) == 8 ? 4 : 0), "kg_frame has another size");
KG_ASSERT(sizeof(kg_observer) == 3 * sizeof(void *) + 8 + (sizeof(void *) == 8 ? 0 : 4), "kg_observer has another size");
KG_ASSERT(sizeof(kg_training) == sizeof(void *) + 16, "kg_training has another size");
KG_ASSERT(sizeof(kg_trained) == sizeof(size_t) + 12 + (sizeof(size_t) == 8 ? 4 : 0), "kg_trained has another size");
KG_ASSERT(sizeof(kg_model_info) == sizeof(size_t) + 24, "kg_model_info has another size");
KG_ASSERT(sizeof(kg_buffer) == 3 * sizeof(size_t), "kg_buffer has another size");
