/* A stand-in for a header of Zephyr: what the sample uses of its video interface (4.1). */
#pragma once
#include <zephyr/device.h>

enum video_buf_type {
	VIDEO_BUF_TYPE_INPUT,
	VIDEO_BUF_TYPE_OUTPUT,
};
#define VIDEO_PIX_FMT_YUYV 1
struct video_format {
	enum video_buf_type type;
	uint32_t pixelformat;
	uint32_t width;
	uint32_t height;
	uint32_t pitch;
};
struct video_buffer {
	enum video_buf_type type;
	uint8_t *buffer;
	uint32_t size;
};
static inline int video_set_format(const struct device *d, struct video_format *f)
{
	return d == NULL || f == NULL;
}
static inline int video_enqueue(const struct device *d, struct video_buffer *b)
{
	return d == NULL || b == NULL;
}
static inline int video_dequeue(const struct device *d, struct video_buffer **b, k_timeout_t t)
{
	(void)t;
	return d == NULL || b == NULL;
}
static inline int video_stream_start(const struct device *d, enum video_buf_type t)
{
	(void)t;
	return d == NULL;
}
