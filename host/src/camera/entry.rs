//! One model in use, as it was given.
//!
//! In: the bytes of a model, and the file that they are from, if there is one. Out: the bytes again, and its objects for
//! the page. Memory: the bytes, unless there is a file: that stays open, so that its name may be removed or given to
//! another one. Cost: reading.

use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use keygraph_core::Model;
use serde_json::{Value, json};

use super::shelf::{Shelf, Stamp};
use crate::file::read_exact_at;
use crate::output::plain;

/// One model as it was given.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The id of the model for as long as the program runs.
    pub id: u64,
    /// The name for people: that of the file, or of the object.
    pub name: String,
    /// The size of the model in bytes.
    pub length: usize,
    /// The file on the shelf; it is removed with the model.
    pub file: Option<PathBuf>,
    /// The SHA-256 of a model that was ordered, 64 hexadecimal digits. Such a model is exchanged, and not
    /// removed.
    pub sha256: Option<String>,
    /// The objects of the model, for the page: `[{"name","width","height"}]`.
    pub objects: Value,
    /// What its file was like when it was read.
    pub stamp: Option<Stamp>,
    /// Stands for the bytes.
    digest: u64,
    place: Place,
}

/// Where the bytes of a model are.
#[derive(Clone, Debug)]
enum Place {
    Memory(Arc<Vec<u8>>),
    File(Arc<File>),
}

impl Entry {
    /// A model with these objects and `bytes`, which are those of the file `opened`, if there is one: then they
    /// do not stay in memory.
    #[must_use]
    pub fn new(name: &str, objects: Value, bytes: Vec<u8>, file: Option<PathBuf>, opened: Option<File>) -> Self {
        let length = bytes.len();
        let mut hasher = DefaultHasher::new();
        bytes.hash(&mut hasher);
        let digest = hasher.finish();
        // Nobody has exchanged it since it was read.
        let opened = opened.filter(|file| file.metadata().is_ok_and(|m| m.len() == length as u64));
        let stamp = opened.as_ref().and_then(|file| Some(Stamp::of(&file.metadata().ok()?)));
        let place = opened.map_or_else(|| Place::Memory(Arc::new(bytes)), |file| Place::File(Arc::new(file)));
        Self { id: 0, name: name.to_string(), length, file, sha256: None, objects, stamp, digest, place }
    }

    /// An ordered model, for the exchange of all ordered ones: `bytes` with this `sha256`, which are those of the file
    /// `opened`, if there is one.
    ///
    /// # Errors
    /// When the model is damaged.
    pub fn ordered(name: &str, sha256: &str, bytes: Vec<u8>, opened: Option<File>) -> Result<Self> {
        let objects = objects_of(&Model::parse(&bytes)?);
        Ok(Self { sha256: Some(sha256.to_string()), ..Self::new(name, objects, bytes, None, opened) })
    }

    /// A model on the shelf, which somebody else may be writing.
    ///
    /// # Errors
    /// When it cannot be read, changes meanwhile, or is damaged.
    pub fn on_shelf(path: &Path) -> Result<Self> {
        let (bytes, opened, stamp) = Shelf::read(path)?;
        let objects = objects_of(&Model::parse(&bytes).with_context(|| path.display().to_string())?);
        let entry = Self::new(&name_for(path), objects, bytes, Some(path.to_path_buf()), Some(opened));
        Ok(Self { stamp: Some(stamp), ..entry })
    }

    /// The bytes of the model.
    ///
    /// # Errors
    /// When its file cannot be read.
    pub fn read(&self) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; self.length];
        self.read_into(0, &mut bytes)?;
        Ok(bytes)
    }

    /// Reads the bytes from `start` on, until `out` is full.
    ///
    /// # Errors
    /// When the file cannot be read, or there are not so many bytes.
    pub fn read_into(&self, start: usize, out: &mut [u8]) -> io::Result<()> {
        match &self.place {
            Place::Memory(bytes) => {
                let part = start.checked_add(out.len()).and_then(|end| bytes.get(start..end));
                out.copy_from_slice(part.ok_or(io::ErrorKind::UnexpectedEof)?);
                Ok(())
            }
            Place::File(file) => read_exact_at(file, out, start as u64),
        }
    }

    /// The model with another id.
    #[must_use]
    pub fn with_id(&self, id: u64) -> Self {
        Self { id, ..self.clone() }
    }

    /// Whether both have the same bytes.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        (self.length, self.digest) == (other.length, other.digest)
    }

    /// The bytes of a model that is in memory.
    #[must_use]
    pub fn in_memory(&self) -> Option<&Arc<Vec<u8>>> {
        match &self.place {
            Place::Memory(bytes) => Some(bytes),
            Place::File(_) => None,
        }
    }

    /// The names of the objects of the model.
    pub fn object_names(&self) -> impl Iterator<Item = &str> {
        self.objects.as_array().into_iter().flatten().filter_map(|object| object["name"].as_str())
    }

    /// The name of the model's file on the shelf.
    #[must_use]
    pub fn file_name(&self) -> Option<String> {
        Some(self.file.as_ref()?.file_name()?.to_string_lossy().into_owned())
    }
}

/// The objects of a model, for the page.
#[must_use]
pub fn objects_of(model: &Model<'_>) -> Value {
    let objects = (0..model.objects()).map(|i| model.object(i));
    objects.map(|o| json!({"name": o.name, "width": o.width, "height": o.height})).collect()
}

/// The name of a model for people: that of its file.
#[must_use]
pub fn name_for(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |stem| plain(&stem.to_string_lossy()).into_owned())
}
