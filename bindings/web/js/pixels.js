// Pictures of a browser as pixels.
//
// In: what shows a picture: ImageData, a canvas, a video, an image, an ImageBitmap, a VideoFrame, a file.
// Out: { format, width, height, data, own }: rows of pixels without padding. `own` tells that nobody else
// has the data, so that they may be handed to a worker without a copy.

import { KeygraphError } from "./engine.js";

const BYTES = { rgba: 4, rgb: 3, gray: 1, i420: 1.5 };

const is = (value, name) => typeof globalThis[name] === "function" && value instanceof globalThis[name];

let canvas = null;

/** Draws what shows a picture, and reads its pixels. */
function drawn(source, width, height) {
  if (!width || !height) {
    throw new KeygraphError("the picture has no pixels yet: wait until it is loaded, or the video plays", "value");
  }
  if (!canvas || canvas.width !== width || canvas.height !== height) {
    if (typeof OffscreenCanvas === "function") canvas = new OffscreenCanvas(width, height);
    else canvas = Object.assign(document.createElement("canvas"), { width, height });
  }
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.clearRect(0, 0, width, height);
  context.drawImage(source, 0, 0, width, height);
  let data;
  try {
    ({ data } = context.getImageData(0, 0, width, height));
  } catch (error) {
    canvas = null;
    throw new KeygraphError(`the picture comes from another address, which does not allow to read it: ${error.message}`, "value");
  }
  return { format: "rgba", width, height, data, own: true };
}

/** The pixels of anything that shows a picture. */
export async function pixelsOf(source) {
  if (source == null) throw new KeygraphError("expected a picture, got nothing", "value");
  if (is(source, "ImageData")) {
    return { format: "rgba", width: source.width, height: source.height, data: source.data, own: false };
  }
  if (is(source, "HTMLVideoElement")) {
    const there = source.readyState >= source.HAVE_CURRENT_DATA;
    return drawn(source, there && source.videoWidth, source.videoHeight);
  }
  if (is(source, "HTMLImageElement")) {
    await source.decode().catch(() => {
      throw new KeygraphError(`${source.src} is no picture that this browser reads`, "value");
    });
    return drawn(source, source.naturalWidth, source.naturalHeight);
  }
  if (is(source, "VideoFrame")) return drawn(source, source.displayWidth, source.displayHeight);
  if (is(source, "HTMLCanvasElement") || is(source, "OffscreenCanvas") || is(source, "ImageBitmap")) {
    return drawn(source, source.width, source.height);
  }
  if (is(source, "Blob")) {
    let bitmap;
    try {
      bitmap = await createImageBitmap(source);
    } catch {
      throw new KeygraphError(`${source.name ?? "the file"} is no picture that this browser reads`, "value");
    }
    try {
      return drawn(bitmap, bitmap.width, bitmap.height);
    } finally {
      bitmap.close();
    }
  }
  const { format, width, height, data } = source;
  if (BYTES[format] && ArrayBuffer.isView(data)) return { format, width, height, data, own: false };
  throw new KeygraphError(
    "expected ImageData, a canvas, a video, an image, an ImageBitmap, a VideoFrame, a file, or " +
      '{ format: "rgba" | "rgb" | "gray" | "i420", width, height, data }',
    "value",
  );
}
