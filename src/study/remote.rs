//! The folder of a study in an object store that speaks S3: what shards on different machines share where there is no common file system.
//!
//! A shard works in a folder of its own machine. It fetches what the store has of the study, sends its journal every half minute and at its end,
//! and the table when it is done. An object is replaced only in the version that this process has seen (If-Match): of two that run the same
//! shard, the second is told and stops. Keys and endpoint come from the environment, as for other S3 clients (AWS_ACCESS_KEY_ID,
//! AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT_URL, AWS_ALLOW_HTTP).

use anyhow::{Context, anyhow};
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt, PutMode, PutPayload, UpdateVersion};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// Time between two copies of a journal: what a machine that is lost may lose.
const SEND_EVERY: Duration = Duration::from_secs(30);

/// The folder of a study in an object store.
pub struct RemoteFolder {
    pub url: String,
    runtime: Runtime,
    store: AmazonS3,
    prefix: Key,
    /// Version of every object that this process has read or written.
    versions: BTreeMap<String, UpdateVersion>,
    sent: Instant,
}

impl RemoteFolder {
    /// `s3://BUCKET/PREFIX`. Asks for nothing yet.
    ///
    /// # Errors
    /// It is no such address, or the environment lacks what the store needs.
    pub fn open(url: &str) -> anyhow::Result<RemoteFolder> {
        let rest = url.strip_prefix("s3://").ok_or_else(|| anyhow!("`{url}` is no s3://BUCKET/PREFIX"))?;
        let (bucket, prefix) = rest.trim_end_matches('/').split_once('/').unwrap_or((rest, ""));
        if bucket.is_empty() || prefix.is_empty() {
            return Err(anyhow!("`{url}` names no folder: write s3://BUCKET/PREFIX"));
        }
        let store = AmazonS3Builder::from_env()
            .with_bucket_name(bucket)
            .build()
            .with_context(|| format!("cannot use {url}"))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let prefix = Key::parse(prefix).with_context(|| format!("`{url}` is no address"))?;
        Ok(RemoteFolder { url: url.into(), runtime, store, prefix, versions: BTreeMap::new(), sent: Instant::now() })
    }

    fn key(&self, name: &str) -> Key {
        name.split('/').fold(self.prefix.clone(), |key, part| key.join(part))
    }

    /// Names of the objects right below the folder.
    fn names(&self) -> anyhow::Result<Vec<String>> {
        let listed = self.runtime.block_on(self.store.list_with_delimiter(Some(&self.prefix)));
        let listed = listed.with_context(|| format!("cannot list {}", self.url))?;
        Ok(listed.objects.iter().filter_map(|o| o.location.filename().map(str::to_string)).collect())
    }

    /// Copies the mark of the study and the journals that `is_wanted` into a folder. A local journal that is longer stays: it is ahead of its
    /// copy.
    ///
    /// # Errors
    /// The store does not answer, or the folder cannot be written.
    pub fn fetch(&mut self, to: &Path, is_wanted: impl Fn(&str) -> bool) -> anyhow::Result<()> {
        for name in self.names()? {
            let is_journal = name.starts_with("shard-") && name.ends_with(".rows");
            let is_mark = name == "study.json" || name == "study.toml";
            if !(is_mark || is_journal && is_wanted(&name)) {
                continue;
            }
            let (bytes, version) = self.get(&name).with_context(|| format!("cannot read {name} in {}", self.url))?;
            self.versions.insert(name.clone(), version);
            let path = to.join(&name);
            let is_behind = std::fs::metadata(&path).map_or(true, |m| m.len() < bytes.len() as u64);
            if is_mark || is_behind {
                std::fs::create_dir_all(to)?;
                crate::output::write(&path, &bytes)?;
            }
        }
        Ok(())
    }

    fn get(&self, name: &str) -> anyhow::Result<(Vec<u8>, UpdateVersion)> {
        self.runtime.block_on(async {
            let found = self.store.get(&self.key(name)).await?;
            let version = UpdateVersion { e_tag: found.meta.e_tag.clone(), version: found.meta.version.clone() };
            Ok((found.bytes().await?.to_vec(), version))
        })
    }

    /// Copies files of a folder into the store, each in place of the version that this process has seen.
    ///
    /// # Errors
    /// The store does not answer, or another process has written the object meanwhile.
    pub fn send(&mut self, from: &Path, names: &[String]) -> anyhow::Result<()> {
        for name in names {
            let path = from.join(name);
            let bytes = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
            let mode = self.versions.get(name).map_or(PutMode::Create, |seen| PutMode::Update(seen.clone()));
            let key = self.key(name);
            let put = self.store.put_opts(&key, PutPayload::from(bytes), mode.into());
            match self.runtime.block_on(put) {
                Ok(put) => drop(self.versions.insert(name.clone(), put.into())),
                Err(object_store::Error::AlreadyExists { .. } | object_store::Error::Precondition { .. }) => {
                    return Err(anyhow!(
                        "another process has written {name} in {} since: it runs the same part of the study; what was done here is in {}",
                        self.url,
                        path.display()
                    ));
                }
                Err(e) => return Err(anyhow!(e).context(format!("cannot write {name} in {}", self.url))),
            }
        }
        self.sent = Instant::now();
        Ok(())
    }

    /// Takes whatever is there as seen: tables of results are replaced.
    ///
    /// # Errors
    /// The store does not answer.
    pub fn see(&mut self, names: &[String]) -> anyhow::Result<()> {
        let there = self.names()?;
        for name in names.iter().filter(|name| there.contains(name)) {
            let meta = self.runtime.block_on(self.store.head(&self.key(name)))?;
            self.versions.insert(name.clone(), UpdateVersion { e_tag: meta.e_tag, version: meta.version });
        }
        Ok(())
    }

    /// Whether it is time for the next copy of a journal.
    pub fn is_due(&self) -> bool {
        self.sent.elapsed() >= SEND_EVERY
    }
}
