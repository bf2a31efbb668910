/**
 * Finds planar objects (books, posters, boxes, signs) in frames, from one picture of each.
 *
 * Everything is computed in workers of the page; no pixel leaves it. Lengths are px of the picture or the
 * frame that was given. Points have their pixel's centre at whole numbers. Each function rejects with a
 * {@link KeygraphError}; a call that its `signal` stops rejects with the reason of the signal.
 */

/** An error that Keygraph reports. */
export declare class KeygraphError extends Error {
  /**
   * `"training"`: the picture has too little to hold on to. `"model"`: the bytes are no model, or damaged.
   * `"value"`: an option, a size or a type is wrong. `"state"`: the WebAssembly file cannot be fetched.
   * `"closed"`: the detector was closed meanwhile. `"defect"`: a fault of Keygraph; open a new detector.
   */
  readonly kind: "training" | "model" | "value" | "state" | "closed" | "defect";
  constructor(message: string, kind?: KeygraphError["kind"]);
}

/** Pixels in rows from the top, without padding. */
export interface Pixels {
  /** `rgba`: 4 bytes a pixel; `rgb`: 3; `gray`: 1; `i420`: planes of Y, U and V, 1.5, of even sides. */
  format: "rgba" | "rgb" | "gray" | "i420";
  /** Pixels in a row. */
  width: number;
  /** Number of rows. */
  height: number;
  /** The pixels. */
  data: Uint8Array | Uint8ClampedArray;
}

/** Anything that shows a picture. Files are decoded by the browser, and turned upright. */
export type Picture =
  | ImageData
  | HTMLCanvasElement
  | OffscreenCanvas
  | HTMLVideoElement
  | HTMLImageElement
  | ImageBitmap
  | VideoFrame
  | Blob
  | Pixels;

/** x and y, px. */
export type Point = [x: number, y: number];

/** How much a model holds: up to 2 MB, 1.5 MB, 512 KB, or the method of the paper as written, up to 8 MB. */
export type Preset = "large" | "standard" | "compact" | "paper";

/** The size that frames are searched at, larger ones are scaled down: 1280x720, 640x480, 320x240 or 160x120 px. */
export type Profile = "hd" | "vga" | "qvga" | "qqvga";

export interface TrainOptions {
  /** Name of the object, up to 32 bytes; `"object"` unless given. */
  name?: string;
  /** How much the model holds; `"large"` unless given. */
  preset?: Preset;
  /** Whether to train on luma alone, for cameras without colour. */
  luma?: boolean;
  /**
   * The object's corners in the picture, its top left first, then clockwise, where the picture shows more
   * than the object, or shows it aslant. Without it, the picture is the object.
   */
  outline?: [Point, Point, Point, Point];
  /** Stops the training. */
  signal?: AbortSignal;
}

/** An object of a model. */
export interface ModelObject {
  readonly name: string;
  /** Width of the picture that it was trained from, px. */
  readonly width: number;
  /** Height of that picture, px. */
  readonly height: number;
}

/** One or many objects to find. It cannot be changed. */
export declare class Model {
  private constructor();
  readonly objects: readonly ModelObject[];
  /** The bytes of a `.kgm` file, as the command line and boards read it. */
  readonly data: Uint8Array;
  /** The length of the model, bytes. */
  readonly bytes: number;
  /** Number of keypoints in all views. */
  readonly keypoints: number;
  /** Number of keygraphs. */
  readonly keygraphs: number;
  /** What the features are made of. */
  readonly feature: "both" | "luma" | "chroma";
  /** Number of views. */
  readonly views: number;
  /** What makes the model less useful than it looks, and what to do; empty for models that were read. */
  readonly warnings: readonly string[];
  /** The picture that it was trained from; `null` for models that were read or packed. */
  readonly picture: ImageData | null;
  /** The model as a file of bytes. */
  blob(): Blob;
}

export interface SearchOptions {
  /** `"vga"` unless given. */
  profile?: Profile;
  /** Minimum score, 0 to 1; 0.8 unless given. */
  threshold?: number;
  /** Minimum share of an object that must be seen and agree, 0 to 1; 0 unless given. */
  minVisible?: number;
  /** Search all of each frame, and again in tiles: finds small objects, in three times the time. */
  thorough?: boolean;
  /** For detectors: find what is seen from far to the side, too, up to some 80 degrees. Eight more searches a frame. */
  wide?: boolean;
  /**
   * For trackers: average outlines over this many frames while they stand still, 1 to 255, so that drawings do not
   * tremble. An outline that moves lags by less than a pixel of the searched frame.
   */
  smooth?: number;
  /** Report all objects that could be at a place, and not the best alone. */
  allNames?: boolean;
  /** Stop the search of a frame after this time, ms, and report what was found. */
  budgetMs?: number;
  /** The part of each frame that is searched: `"x,y,width,height"`, each px or percent. */
  roi?: string;
  /** Search frames mirrored left to right, as selfie cameras show them. */
  mirror?: boolean;
  /** Shape that objects may have; with `"any"`, unless given, bent ones have a `surface`. */
  surface?: "any" | "plane";
  /** Report a digest of each stage's output, to compare machines by. Frames of trackers have none. */
  digests?: boolean;
  /** The camera: fx, fy, cx, cy, px of the frame. With `widthMm`, detections have a pose in space. */
  intrinsics?: [fx: number, fy: number, cx: number, cy: number];
  /** With `intrinsics`: coefficients of the lens in OpenCV's order. Each detection then has a `surface`. */
  distortion?: number[];
  /** Whether these are the 4 coefficients of a fisheye lens. */
  fisheye?: boolean;
  /** True width of all objects, or of each by its name, mm. */
  widthMm?: number | Record<string, number>;
}

export interface FrameOptions {
  /** Whether to report corners and triangles. A tracker then searches every frame. */
  details?: boolean;
  /** Name of the frame's source in the result. */
  source?: string;
  /** Index of the frame in its source. */
  frame?: number;
}

/** A pose in space: the object's axes in those of the camera (x right, y down, z ahead). */
export interface Pose {
  /** 3 x 3, row by row. */
  rotation: number[];
  /** The object's centre, mm. */
  translation_mm: [number, number, number];
  /** Distance of the projected corners from those found, px. */
  error_px: number;
}

/** An object in a frame. docs/detection.md describes each field. */
export interface Detection {
  object: string;
  state: "found" | "tracked" | "lost";
  /** Estimated probability that the detection is right, 0 to 1. */
  score: number;
  /** Share of the object that is seen and agrees, 0 to 1. */
  visible: number;
  /** From px of the picture to px of the frame: 3 x 3, row by row. */
  homography: number[];
  /** Where the picture's corners are, px: top left, top right, bottom right, bottom left. */
  corners: [Point, Point, Point, Point];
  votes: number;
  agreeing: number;
  correlation: number;
  support: number;
  strong: number;
  blocks: number;
  inside: number;
  chroma: number;
  /**
   * Where the picture lies when a plane does not explain what is seen: a grid of points of it, row by row, px of
   * the frame.
   */
  surface?: { bent: boolean; homography: number[]; cols: number; rows: number; points: Point[] };
  /** Other objects that could be at this place. */
  rivals?: { object: string; score: number }[];
  /** With a tracker: the number of the instance. */
  id?: number;
  /** With a tracker, for lost instances: frames since it was seen. */
  unseen?: number;
  /** With intrinsics, for a bent object: the cylinder that fits its surface best. */
  cylinder?: Pose & { radius_mm: number; inside: boolean; axis: number[]; centre_mm: number[] };
  /** With intrinsics: the pose; `null` when none fits, and for a bent object. */
  pose?: (Pose & { ambiguous: boolean; mirrored: Pose }) | null;
}

/** What was found in a frame: the line that `keygraph detect --json` prints. */
export interface FrameResult {
  source: string;
  frame: number;
  width: number;
  height: number;
  /** Best score first. */
  detections: Detection[];
  /** How many elements each stage saw, kept, and dropped because its buffer was full. */
  stages: Record<string, { seen: number; kept: number; dropped: number }>;
  /** Time of each stage, and in `total`, ms. */
  time_ms: Record<string, number>;
  /** The part that was searched. */
  roi?: [number, number, number, number];
  mirror?: true;
  /** The search was stopped by `budgetMs`. */
  complete?: false;
  digests?: Record<string, string>;
  /** With a tracker. */
  state?: "tracking" | "searching";
  /** With a tracker: whether the frame was searched. */
  searched?: boolean;
  /** With a tracker: instances that are out of sight, as they were seen last. */
  lost?: Detection[];
  /** With `details`. */
  details?: {
    /** x, y of each corner, px. */
    corners: Float32Array;
    /** x, y of three corners of each triangle that was classified, px. */
    keygraphs: Float32Array;
    /** x, y of three corners of each triangle that agrees with a detection, px. */
    votes: Float32Array;
  };
}

/**
 * Finds objects in frames, each frame by itself. It has a worker of its own, so that several detectors
 * search at once; its frames are searched in the order in which they come.
 */
export declare class Detector {
  protected constructor();
  /** What is searched for. */
  readonly model: Model;
  /** Memory of the module, bytes. It does not grow from frame to frame. */
  readonly memory: number;
  /** Searches a frame. */
  detect(image: Picture, options?: FrameOptions): Promise<FrameResult>;
  /** Ends the worker. Frames that are not searched yet reject with the kind `"closed"`. */
  close(): void;
}

/** Follows objects from frame to frame of one camera or video: most frames take two milliseconds. */
export declare class Tracker extends Detector {
  /** Follows objects into the next frame. */
  track(image: Picture, options?: FrameOptions): Promise<FrameResult>;
  /** Makes the next frame the first of a new sequence. */
  reset(): Promise<void>;
}

export interface AssessOptions {
  /** The picture that the model was made from; not needed for models of `train`. */
  picture?: Picture;
  /** Size of the frames; `"vga"` unless given. */
  profile?: Profile;
  /** Frames for each cell of the table, 1 to 1000; 8 unless given. */
  views?: number;
  /** Stops the assessment. */
  signal?: AbortSignal;
  /** Is called after each frame. */
  onProgress?: (done: number, all: number) => void;
}

/** How well a picture will be found. */
export interface Assessment {
  object: string;
  /** 0 to 100. */
  score: number;
  /** Frames for each cell. */
  views: number;
  table: { condition: string; unit: string; rate: number; cells: { value: number; found: number }[] }[];
  /** Number of outlines at wrong places. */
  wrong: number;
  /** For each share of exchanged parts, %: how often the look-alike was taken for the object. */
  look_alikes: { value: number; found: number }[];
  structure: {
    keypoints: number;
    keygraphs: number;
    spread: number;
    contrast: number;
    repetition: number;
    width: number;
    height: number;
    luma_only: boolean;
  };
  /** What limits the score, and what to do. */
  limits: { kind: string; text: string }[];
  /** The picture, bright where what it is recognised by lies. */
  heat: ImageData;
}

export interface Keygraph {
  /**
   * Where there is no `fetch` of files or no `Worker` (Node.js): the compiled module, and `worker: false`,
   * which computes in the caller's thread.
   */
  configure(options: { module?: WebAssembly.Module; worker?: boolean }): void;
  /** Fetches and compiles the WebAssembly, 0.3 MB. All other functions do so when they are first called. */
  ready(): Promise<void>;
  /** Trains a model of one picture of an object. It takes a second. */
  train(image: Picture, options?: TrainOptions): Promise<Model>;
  /** Reads a model: the bytes of a `.kgm` file, or the file. */
  read(file: Blob | ArrayBuffer | ArrayBufferView): Promise<Model>;
  /** Merges models into one. */
  pack(models: Model[]): Promise<Model>;
  /** Renders frames of a picture, searches them, and tells how often it was found. It takes some seconds. */
  assess(model: Model, options?: AssessOptions): Promise<Assessment>;
  /** Opens a detector for one or several models. */
  detector(models: Model | Model[], options?: SearchOptions): Promise<Detector>;
  /** Opens a tracker for one or several models. */
  tracker(models: Model | Model[], options?: SearchOptions): Promise<Tracker>;
}

export declare const Keygraph: Keygraph;
export default Keygraph;
