//! Carries out orders: fetches models, keeps them, and exchanges them for those in use.
//!
//! In: an [`Order`]. Out: the models in use are those of the order, beside those that were given
//! to this program alone. All are exchanged at once, between two frames, or none. With a folder,
//! they are kept there, and are in use again from the next start on, before the broker is reached.
//!
//! Memory: one model, and without a folder all of them. Cost: a request for each model that is
//! not here yet, and a merge.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, ensure};

use super::super::entry::Entry;
use super::super::models::Models;
use super::fetch::Fetcher;
use super::order::{Order, Part, sha256};
use crate::file::read_regular;
use crate::output::write_file;

/// The file of the last order that was carried out.
const ORDER: &str = "order.json";

/// Keeps the models of orders, and the order that is run.
#[derive(Debug)]
pub struct Fleet {
    folder: Option<PathBuf>,
    fetcher: Fetcher,
    running: Mutex<Option<Order>>,
}

impl Fleet {
    /// Keeps models in `folder`, if there is one, and fetches them with `fetcher`.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn open(folder: Option<PathBuf>, fetcher: Fetcher) -> Result<Self> {
        if let Some(folder) = &folder {
            fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        }
        Ok(Self { folder, fetcher, running: Mutex::default() })
    }

    /// The order whose models are in use.
    pub fn running(&self) -> MutexGuard<'_, Option<Order>> {
        // Every change is made in one assignment.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Carries out the order that the folder holds. One that cannot be is left out and logged.
    pub fn resume(&self, models: &Models) {
        let Some(kept) = self.folder.as_ref().map(|folder| folder.join(ORDER)).filter(|path| path.exists()) else {
            return;
        };
        let order = read_regular(&kept).map_err(anyhow::Error::from).and_then(|text| Order::parse(&text));
        let resumed = order.and_then(|order| {
            let parts = order.models.iter();
            let entries = parts.map(|part| self.at_hand(part, models).with_context(|| part.name.clone()));
            models.exchange(entries.collect::<Result<_>>()?)?;
            Ok(order)
        });
        match resumed {
            Ok(order) => {
                tracing::info!("order {}: {} models, as before", order.version, order.models.len());
                *self.running() = Some(order);
            }
            Err(error) => tracing::error!("left out: {}: {error:#}", kept.display()),
        }
    }

    /// Carries out an order, as long as `goes_on` holds. Returns the number of models fetched.
    ///
    /// # Errors
    /// When a model cannot be fetched or kept, is damaged, or does not go with the others; then
    /// the models in use stay as they were.
    pub fn carry_out(&self, order: &Order, models: &Models, goes_on: &dyn Fn() -> bool) -> Result<usize> {
        let mut fetched = 0;
        let entries = order.models.iter().map(|part| {
            self.at_hand(part, models).or_else(|_| {
                fetched += 1;
                self.fetch(part, goes_on)
            })
        });
        let entries = entries.collect::<Result<Vec<_>>>()?;
        models.exchange(entries)?;
        *self.running() = Some(order.clone());
        if let Err(error) = self.keep(order) {
            tracing::warn!("order {} will not be in use from the next start on: {error:#}", order.version);
        }
        Ok(fetched)
    }

    /// The model of `part`, if it is in use or in the folder.
    fn at_hand(&self, part: &Part, models: &Models) -> Result<Entry> {
        if let Some(mut entry) = models.ordered(&part.sha256) {
            entry.name.clone_from(&part.name);
            return Ok(entry);
        }
        let path = self.path(part).context("there is no folder of models")?;
        let bytes = read_regular(&path).with_context(|| format!("cannot read {}", path.display()))?;
        ensure!(sha256(&bytes) == part.sha256, "{} was changed", path.display());
        Entry::ordered(&part.name, &part.sha256, bytes, File::open(&path).ok())
    }

    fn fetch(&self, part: &Part, goes_on: &dyn Fn() -> bool) -> Result<Entry> {
        let Some(path) = self.path(part) else {
            let mut bytes = Vec::new();
            self.fetcher.fetch(part, &mut bytes, goes_on)?;
            return Entry::ordered(&part.name, &part.sha256, bytes, None).with_context(|| part.place());
        };
        write_file(&path, |file| self.fetcher.fetch(part, file, goes_on))?;
        let bytes = read_regular(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let entry = Entry::ordered(&part.name, &part.sha256, bytes, File::open(&path).ok());
        entry.with_context(|| part.place())
    }

    fn path(&self, part: &Part) -> Option<PathBuf> {
        Some(self.folder.as_ref()?.join(format!("{}.kgm", part.sha256)))
    }

    /// Keeps the order for the next start, and removes models that it does not have.
    fn keep(&self, order: &Order) -> Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let text = serde_json::to_vec(order)?;
        write_file(&folder.join(ORDER), |file| Ok(file.write_all(&text)?))?;
        let is_of_order = |path: &Path| {
            let stem = path.file_stem().and_then(|stem| stem.to_str());
            order.models.iter().any(|part| Some(part.sha256.as_str()) == stem)
        };
        for entry in fs::read_dir(folder)?.flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|e| e == "kgm") && !is_of_order(&path) {
                // What cannot be removed is in nobody's way.
                let _ = fs::remove_file(path);
            }
        }
        Ok(())
    }
}
