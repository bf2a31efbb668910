//! The plugin `keygraph` for GStreamer, with the element `keygraphdetect`.
//!
//! A file uses only files above it:
//!
//! - [`pixels`]: buffers of GStreamer as pictures
//! - [`drawing`]: outlines, drawn into a buffer
//! - [`element`]: the element

mod pixels;
mod drawing;
mod element;

#[allow(unsafe_code, missing_docs, reason = "the macro's own code; the plugin is used by its name")]
mod plugin {
    use super::element::register;
    use gstreamer as gst;

    gst::plugin_define!(
        keygraph,
        env!("CARGO_PKG_DESCRIPTION"),
        register,
        env!("CARGO_PKG_VERSION"),
        "MIT/X11",
        env!("CARGO_PKG_NAME"),
        env!("CARGO_PKG_NAME"),
        "bindings/gstreamer"
    );
}
