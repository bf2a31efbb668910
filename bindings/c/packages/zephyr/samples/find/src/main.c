/* Finds a cover in front of the camera of the board (chosen zephyr,camera), 320x240 px, YUYV.
 *
 * Before: keygraph train cover.jpg --preset compact -o cover.kgm, beside CMakeLists.txt.
 * It has been compiled against stand-ins of Zephyr's headers only. */
#include <keygraph.h>
#include <zephyr/device.h>
#include <zephyr/drivers/video.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/printk.h>

static const uint8_t cover[] __aligned(4) = {
#include <cover.kgm.inc>
};

KG_MEMORY(memory, KG_QVGA_DETECTOR_BYTES);
KG_MEMORY(buffer_memory, 2 * 320 * 240);

static kg_model model;
static kg_detector *detector;

static void report(void)
{
	static kg_detection found[KG_DETECTIONS];
	size_t count = 0;

	if (kg_detector_detections(detector, found, KG_DETECTIONS, &count) < 0) {
		return;
	}
	for (size_t i = 0; i < count; i++) {
		kg_object object;

		if (kg_model_object(&model, found[i].object, &object) >= 0) {
			printk("%s %d %% (%d, %d)\n", object.name, (int)(100 * found[i].score),
			       (int)found[i].outline[0][0], (int)found[i].outline[0][1]);
		}
	}
}

int main(void)
{
	const struct device *camera = DEVICE_DT_GET(DT_CHOSEN(zephyr_camera));
	struct video_format format = {
		.type = VIDEO_BUF_TYPE_OUTPUT,
		.pixelformat = VIDEO_PIX_FMT_YUYV,
		.width = 320,
		.height = 240,
		.pitch = 640,
	};
	struct video_buffer buffer = {.type = VIDEO_BUF_TYPE_OUTPUT};
	struct video_buffer *full = &buffer;
	kg_status status = kg_model_open(&model, cover, sizeof(cover));

	if (status >= 0) {
		status = kg_detector_init(memory, sizeof(memory), KG_PROFILE_QVGA, &detector);
	}
	if (status < 0) {
		printk("%s\n", kg_status_text(status));
		return 0;
	}
	buffer.buffer = buffer_memory;
	buffer.size = sizeof(buffer_memory);
	if (!device_is_ready(camera) || video_set_format(camera, &format) != 0 || video_enqueue(camera, &buffer) != 0 ||
	    video_stream_start(camera, VIDEO_BUF_TYPE_OUTPUT) != 0) {
		printk("the camera does not start: is it the chosen zephyr,camera, with YUYV of 320x240 px?\n");
		return 0;
	}
	while (video_dequeue(camera, &full, K_FOREVER) == 0) {
		const kg_frame frame = {.data = full->buffer,
					.bytes = sizeof(buffer_memory),
					.format = KG_FORMAT_YUYV,
					.width = 320,
					.height = 240};

		status = kg_detector_detect(detector, &model, &frame, NULL, NULL);
		video_enqueue(camera, full);
		if (status < 0) {
			printk("%s\n", kg_status_text(status));
		} else {
			report();
		}
	}
	return 0;
}
