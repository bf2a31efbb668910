// The service worker: keeps the page, so that it works without a network after the first visit.
//
// In: requests of the page. Out: the kept file, or that of the network. scripts/package-web writes the
// version, so that a changed page replaces the kept one when the last page of it is closed, and the list of
// files.

const VERSION = "development";
const FILES = ["./"];
const NAME = `keygraph-${VERSION}`; // The address may hold other pages, with caches of their own.

self.addEventListener("install", (event) => {
  event.waitUntil(
    caches
      .open(NAME)
      // The browser's own cache may hold files of an older version.
      .then((cache) => cache.addAll(FILES.map((file) => new Request(file, { cache: "reload" })))),
  );
});

self.addEventListener("activate", (event) => {
  event.waitUntil(
    caches
      .keys()
      .then((names) => Promise.all(names.filter((name) => name.startsWith("keygraph-") && name !== NAME).map((name) => caches.delete(name))))
      .then(() => self.clients.claim()),
  );
});

self.addEventListener("fetch", (event) => {
  if (event.request.method !== "GET" || new URL(event.request.url).origin !== location.origin) return;
  const kept = caches.open(NAME).then((cache) => cache.match(event.request, { ignoreSearch: true }));
  event.respondWith(kept.then((answer) => answer ?? fetch(event.request)));
});
