// How programs use the package: this must compile, and what is marked must not.

import Keygraph, { KeygraphError, Model, type Detection, type FrameResult } from "@keygraph/web";

export async function main(picture: ImageBitmap, video: HTMLVideoElement, canvas: HTMLCanvasElement): Promise<Detection[]> {
  Keygraph.configure({ worker: true });
  await Keygraph.ready();
  const stop = new AbortController();
  const outline: [[number, number], [number, number], [number, number], [number, number]] = [[0, 0], [9, 0], [9, 9], [0, 9]];
  const model: Model = await Keygraph.train(picture, { name: "cover", preset: "compact", luma: true, outline, signal: stop.signal });
  const again = await Keygraph.read(model.blob());
  const both = await Keygraph.pack([model, again]);
  const report = await Keygraph.assess(model, { views: 2, onProgress: (done, all) => console.log(done / all) });
  canvas.getContext("2d")?.putImageData(report.heat, 0, 0);
  const detector = await Keygraph.detector([model, again], { profile: "qvga", threshold: 0.7, minVisible: 0.2, roi: "0,0,50%,100%" });
  const tracker = await Keygraph.tracker(both, { intrinsics: [600, 600, 320, 240], widthMm: { cover: 210 }, smooth: 8 });
  const line: FrameResult = await detector.detect(canvas, { details: true });
  const corners: Float32Array | undefined = line.details?.corners;
  console.log(corners?.length, line.time_ms["total"], model.objects[0]?.name, model.warnings.join());
  const { detections } = await tracker.track(video);
  await tracker.reset();
  detector.close();
  try {
    await Keygraph.train({ format: "gray", width: 1, height: 1, data: new Uint8Array(1) });
  } catch (error) {
    if (error instanceof KeygraphError && error.kind === "training") console.log(error.message);
  }
  // @ts-expect-error: there is no such option
  await Keygraph.detector(model, { treshold: 0.5 });
  // @ts-expect-error: there is no such preset
  await Keygraph.train(picture, { preset: "huge" });
  // @ts-expect-error: models are made by Keygraph
  new Model();
  // @ts-expect-error: a picture is expected
  await detector.detect("picture.jpg");
  return detections;
}
