// A worker with one instance of the module. `keygraph.js` starts it.
//
// In: first the compiled module, then requests { id, head, parts }. Out: { id, head, bytes }, { id, error },
// and { progress } while a picture is assessed.

import { Engine } from "./engine.js";

let engine;

onmessage = async ({ data }) => {
  const { id, module, head, parts } = data;
  try {
    if (module) {
      engine = await Engine.start(module, (done, all) => postMessage({ progress: [done, all] }));
      postMessage({ id, head: {}, bytes: new Uint8Array() });
      return;
    }
    const answer = engine.ask(head, parts);
    postMessage({ id, ...answer, memory: engine.memory }, [answer.bytes.buffer]);
  } catch (error) {
    postMessage({ id, error: { message: error.message, kind: error.kind ?? "defect" } });
  }
};
