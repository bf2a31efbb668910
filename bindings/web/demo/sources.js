// Where frames come from: a camera, a video file, or the example's pictures.
//
// In: what the user chose. Out: sources with next(), which gives the next frame as an ImageBitmap, or null
// at the end, and close().

/** A video element that plays, frame by frame. */
class Playing {
  #video = document.createElement("video");
  #ended = null;

  async start(show) {
    Object.assign(this.#video, { muted: true, playsInline: true, loop: false });
    show(this.#video);
    await this.#video.play();
    return this;
  }

  /** Ends the source; `why` is told to whoever waits. */
  end(why = null) {
    this.#ended = { why };
  }

  async next() {
    const video = this.#video;
    await new Promise((go) => {
      // A browser calls back with the next frame, but not when there is none any more.
      const late = setTimeout(go, 1000);
      const soon = () => (clearTimeout(late), go());
      if (video.requestVideoFrameCallback) video.requestVideoFrameCallback(soon);
      else requestAnimationFrame(soon);
    });
    if (this.#ended) {
      if (this.#ended.why) throw this.#ended.why;
      return null;
    }
    return video.ended ? null : createImageBitmap(video);
  }

  close() {
    this.#ended ??= {};
    this.#video.srcObject?.getTracks().forEach((track) => track.stop());
    if (this.#video.src) URL.revokeObjectURL(this.#video.src);
    this.#video.removeAttribute("src");
    this.#video.srcObject = null;
  }
}

const REASONS = {
  NotAllowedError: "The browser does not allow the camera: allow it for this page, then start again.",
  NotFoundError: "There is no camera: open a video, or play the example.",
  NotReadableError: "The camera is in use by another program: end that, then start again.",
};

/** A camera; `id` is null for the one at the back of a phone, or any. */
export async function camera(id) {
  if (!navigator.mediaDevices?.getUserMedia) {
    throw new Error("Browsers give the camera only to pages from https:// or localhost. Open a video, or play the example.");
  }
  const size = { width: { ideal: 640 }, height: { ideal: 480 } };
  const which = id ? { deviceId: { exact: id } } : { facingMode: { ideal: "environment" } };
  let stream;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ audio: false, video: { ...size, ...which } });
  } catch (error) {
    throw new Error(REASONS[error.name] ?? `The camera cannot be opened: ${error.message}`);
  }
  const source = new Playing();
  const [track] = stream.getVideoTracks();
  track.onended = () => source.end(new Error("The camera was taken away: plug it in, then start again."));
  try {
    await source.start((video) => (video.srcObject = stream));
  } catch (error) {
    source.close();
    throw new Error(`The camera gives no picture: ${error.message}`);
  }
  return Object.assign(source, { id: track.getSettings().deviceId });
}

/** The cameras that there are; they have names once one was allowed. */
export async function cameras() {
  const devices = (await navigator.mediaDevices?.enumerateDevices?.()) ?? [];
  return devices.filter((device) => device.kind === "videoinput");
}

/** A video file. */
export async function video(file) {
  const source = new Playing();
  try {
    return await source.start((element) => (element.src = URL.createObjectURL(file)));
  } catch {
    source.close();
    throw new Error(`${file.name} is no video that this browser plays: WebM and MP4 work nearly everywhere.`);
  }
}

/** The example: pictures, twelve a second, again and again. */
export function example(count) {
  let index = 0;
  let closed = false;
  let due = performance.now();
  return {
    async next() {
      due = Math.max(due + 1000 / 12, performance.now());
      const url = `example/${String(index++ % count).padStart(2, "0")}.jpg`;
      const response = await fetch(url);
      if (!response.ok) throw new Error(`${url}: ${response.status} ${response.statusText}`);
      const bitmap = await createImageBitmap(await response.blob());
      await new Promise((go) => setTimeout(go, due - performance.now()));
      return closed ? null : bitmap;
    },
    close: () => (closed = true),
  };
}
