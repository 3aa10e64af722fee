//! Files that are written. No output is ever one of the inputs, and what was there before stays until what replaces it is
//! whole.
//!
//! * A file that is of use only when it is whole ([`OutputFile::whole`]) is written under a hidden name beside its own, `.NAME.*.part`,
//!   and is renamed at the end. Given up, it leaves nothing; a program that is killed leaves the hidden file.
//! * A recording can be read while it grows ([`OutputFile::growing`]). Where its name is free it has that name from the start.
//!   Where a file of that name is there already, the recording grows as `NAME.unfinished.mcap` beside it, and replaces the
//!   other when the run has ended well. A run that is killed leaves it, and the other.
//! * A pipe or a device is written to as it is.

use anyhow::{Context, Result, bail};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Names that are tried for a file beside another one.
const MOST_NAMES: usize = 1000;
/// Symbolic links that are followed one after the other.
const MOST_LINKS: usize = 40;

/// Where the bytes go until they are whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// Under another name, renamed by [`OutputFile::publish`], removed if that never comes.
    Hidden,
    /// Under another name, renamed by [`OutputFile::publish`], left if that never comes.
    Unfinished,
    /// Under its own name, which was free.
    Own,
    /// A pipe or a device.
    Stream,
}

/// A file that is being written.
#[derive(Debug)]
pub struct OutputFile {
    /// As the user wrote it.
    path: PathBuf,
    /// The file behind symbolic links.
    target: PathBuf,
    written_as: PathBuf,
    way: Way,
    published: bool,
}

impl OutputFile {
    /// For a file that nobody can use before it is whole.
    pub fn whole(path: &Path) -> Result<(OutputFile, File)> {
        OutputFile::open(path, false).with_context(|| format!("cannot write {}", path.display()))
    }

    /// For a recording, which can be read while it grows.
    pub fn growing(path: &Path) -> Result<(OutputFile, File)> {
        OutputFile::open(path, true).with_context(|| format!("cannot write {}", path.display()))
    }

    fn open(path: &Path, grows: bool) -> Result<(OutputFile, File)> {
        // What is no file is written to by the name that was given: links to pipes lead nowhere.
        if let Ok(there) = std::fs::metadata(path)
            && !there.is_file()
            && !there.is_dir()
        {
            let (path, way) = (path.to_path_buf(), Way::Stream);
            let file = stream(&path)?;
            let (target, written_as) = (path.clone(), path.clone());
            return Ok((OutputFile { path, target, written_as, way, published: false }, file));
        }
        let target = followed(path)?;
        let output = |written_as: PathBuf, way| OutputFile {
            path: path.to_path_buf(),
            target: target.clone(),
            written_as,
            way,
            published: false,
        };
        match std::fs::metadata(&target) {
            Ok(there) if there.is_dir() => bail!("it is a directory"),
            Ok(there) if there.permissions().readonly() => bail!("it is write-protected"),
            Ok(there) => {
                let (beside, file) = if grows { unfinished(&target)? } else { hidden(&target)? };
                let output = output(beside, if grows { Way::Unfinished } else { Way::Hidden });
                // As readable to others as what it replaces.
                file.set_permissions(there.permissions())?;
                Ok((output, file))
            }
            Err(e) if e.kind() != ErrorKind::NotFound => Err(e.into()),
            Err(_) if grows => {
                // Fails where somebody else has made it meanwhile: nothing that is there is ever opened for writing.
                let file = OpenOptions::new().read(true).write(true).create_new(true).open(&target)?;
                Ok((output(target.clone(), Way::Own), file))
            }
            Err(_) => {
                let (beside, file) = hidden(&target)?;
                Ok((output(beside, Way::Hidden), file))
            }
        }
    }

    /// The name that the user gave.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the bytes are now.
    pub fn lies_at(&self) -> &Path {
        if self.published || self.way == Way::Own { &self.path } else { &self.written_as }
    }

    /// Waits until the bytes are on the disk; a pipe or a device has none.
    pub fn sync(&self, file: &File) -> std::io::Result<()> {
        if self.way == Way::Stream { Ok(()) } else { file.sync_all() }
    }

    /// Gives the whole file its own name, in place of what was there. Called again it does nothing.
    pub fn publish(&mut self) -> Result<()> {
        if !self.published && matches!(self.way, Way::Hidden | Way::Unfinished) {
            std::fs::rename(&self.written_as, &self.target).with_context(|| {
                format!("cannot write {}; it lies whole in {}", self.path.display(), self.written_as.display())
            })?;
        }
        self.published = true;
        Ok(())
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        if !self.published && self.way == Way::Hidden {
            // What cannot be removed is hidden, and nobody's input.
            let _removed = std::fs::remove_file(&self.written_as);
        }
    }
}

/// Writes a file as a whole: it is there with all its bytes, or as it was before.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let (mut output, mut file) = OutputFile::whole(path)?;
    let written = file.write_all(bytes).and_then(|()| output.sync(&file));
    written.with_context(|| format!("cannot write {}", path.display()))?;
    output.publish()
}

/// The file that a path means, also where its last link leads to one that is not there yet.
fn followed(path: &Path) -> std::io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        match std::fs::read_link(&path) {
            Ok(to) => path = path.parent().map_or(to.clone(), |folder| folder.join(to)),
            // Not a link, or not there.
            Err(_) => return Ok(path),
        }
    }
    Err(std::io::Error::other("too many symbolic links"))
}

/// A new file `.NAME.NUMBER.part` beside `target`.
fn hidden(target: &Path) -> Result<(PathBuf, File)> {
    let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let process = std::process::id();
    beside(target, |number| format!(".{name}.{process}-{number}.part"))
}

/// A new file `STEM.unfinished.EXTENSION` beside `target`.
fn unfinished(target: &Path) -> Result<(PathBuf, File)> {
    let stem = target.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = target.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    beside(target, |number| match number {
        0 => format!("{stem}.unfinished{extension}"),
        _ => format!("{stem}.unfinished-{}{extension}", number + 1),
    })
}

fn beside(target: &Path, name: impl Fn(usize) -> String) -> Result<(PathBuf, File)> {
    for number in 0..MOST_NAMES {
        let path = target.with_file_name(name(number));
        match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
            Ok(file) => return Ok((path, file)),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e.into()),
        }
    }
    bail!("{} and all names like it are taken", target.with_file_name(name(0)).display())
}

/// Opens a pipe or a device. A pipe without a reader would hold the program for ever.
fn stream(path: &Path) -> Result<File> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
        use std::time::{Duration, Instant};
        /// How long a pipe may be without a reader.
        const PATIENCE: Duration = Duration::from_secs(5);
        if std::fs::metadata(path)?.file_type().is_fifo() {
            let asked = Instant::now();
            let mut said = false;
            loop {
                let mut options = OpenOptions::new();
                options.write(true).custom_flags(rustix::fs::OFlags::NONBLOCK.bits().cast_signed());
                match options.open(path) {
                    // There is a reader: opened once more, writing waits for it.
                    Ok(_first) => return Ok(OpenOptions::new().write(true).open(path)?),
                    Err(e) if e.raw_os_error() != Some(rustix::io::Errno::NXIO.raw_os_error()) => return Err(e.into()),
                    Err(_) if asked.elapsed() > PATIENCE => bail!("nobody reads this pipe"),
                    Err(_) => {}
                }
                if !std::mem::replace(&mut said, true) {
                    eprintln!("{} is a pipe that nobody reads yet; waiting for {PATIENCE:?}", path.display());
                }
                std::thread::sleep(Duration::from_millis(50));
            }
        }
    }
    Ok(OpenOptions::new().write(true).open(path)?)
}

/// Whether two paths mean one file, by whatever name; for a file that is not there yet, one place.
pub fn same_file(a: &Path, b: &Path) -> bool {
    if let (Ok(a), Ok(b)) = (identity(a), identity(b)) {
        return a == b;
    }
    let place = |path: &Path| {
        let path = followed(path).ok()?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        Some((folder.canonicalize().ok()?, path.file_name()?.to_os_string()))
    };
    place(a).is_some_and(|a| place(b) == Some(a))
}

/// Device and inode. Never opens the file: a pipe would wait for its other end.
#[cfg(unix)]
fn identity(path: &Path) -> std::io::Result<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    let there = std::fs::metadata(path)?;
    Ok((there.dev(), there.ino()))
}

#[cfg(not(unix))]
fn identity(path: &Path) -> std::io::Result<PathBuf> {
    path.canonicalize()
}

/// Checks outputs before anything is computed: no directory, no input, no file twice. The error is one sentence.
pub fn check<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path> + Clone,
) -> Result<(), String> {
    let mut seen: Vec<&Path> = Vec::new();
    for path in outputs {
        let shown = path.display();
        if path.is_dir() {
            return Err(format!("{shown} is a directory, not a file to write"));
        }
        if path.file_name().is_none() {
            return Err(format!("{shown} is no name of a file to write"));
        }
        // A device swallows everything, and may do so twice.
        let is_device = std::fs::metadata(path).is_ok_and(|there| !there.is_file());
        if let Some(other) = seen.iter().find(|other| !is_device && same_file(path, other)) {
            return Err(if path == *other {
                format!("{shown} is given twice")
            } else {
                format!("{shown} and {} are one file", other.display())
            });
        }
        for input in inputs.clone() {
            if same_file(path, input) {
                let what = if input.extension().is_some_and(|e| e == "toml") { "the drive" } else { "the input" };
                let what = if path == input { format!("{what} itself") } else { format!("{what} {}", input.display()) };
                return Err(format!("{shown} is {what}; it is not overwritten"));
            }
        }
        seen.push(path);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_whole_or_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.svg");
        write(&path, b"one").unwrap();
        let (output, mut file) = OutputFile::whole(&path).unwrap();
        file.write_all(b"tw").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        drop((output, file));
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
    }

    #[test]
    fn a_recording_grows_beside_the_one_that_it_replaces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let (mut first, mut file) = OutputFile::growing(&path).unwrap();
        file.write_all(b"first").unwrap();
        assert_eq!(first.lies_at(), path);
        first.publish().unwrap();
        let (second, mut file) = OutputFile::growing(&path).unwrap();
        file.write_all(b"second").unwrap();
        let kept = second.lies_at().to_path_buf();
        assert_eq!(kept, folder.path().join("a.unfinished.mcap"));
        // Given up: both are there.
        drop(second);
        assert_eq!(std::fs::read(&kept).unwrap(), b"second");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        let (mut third, mut file) = OutputFile::growing(&path).unwrap();
        assert_eq!(third.lies_at(), folder.path().join("a.unfinished-2.mcap"));
        file.write_all(b"third").unwrap();
        third.publish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
    }

    #[cfg(unix)]
    #[test]
    fn one_file_is_known_by_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a.mcap"), b"a").unwrap();
        std::fs::hard_link(at("a.mcap"), at("hard.mcap")).unwrap();
        std::os::unix::fs::symlink(at("a.mcap"), at("soft.mcap")).unwrap();
        std::os::unix::fs::symlink("new.mcap", at("dangling.mcap")).unwrap();
        std::os::unix::fs::symlink(folder.path(), at("folder")).unwrap();
        let (a, new) = (at("a.mcap"), at("new.mcap"));
        for name in ["a.mcap", "./a.mcap", "hard.mcap", "soft.mcap", "folder/a.mcap"] {
            let said = check([at(name).as_path()], [a.as_path()]).unwrap_err();
            assert!(said.contains("is the input") && said.ends_with("it is not overwritten"), "{name}: {said}");
        }
        for name in ["dangling.mcap", "folder/new.mcap", "./new.mcap"] {
            let said = check([at(name).as_path(), new.as_path()], []).unwrap_err();
            assert!(said.ends_with("are one file") || said.ends_with("given twice"), "{name}: {said}");
        }
        check([new.as_path()], [a.as_path()]).unwrap();
        // A link is followed: what it leads to is replaced, and the link stays.
        write(&at("soft.mcap"), b"b").unwrap();
        write(&at("dangling.mcap"), b"c").unwrap();
        assert!(at("soft.mcap").is_symlink() && at("dangling.mcap").is_symlink());
        assert_eq!((std::fs::read(a).unwrap(), std::fs::read(new).unwrap()), (b"b".to_vec(), b"c".to_vec()));
        // The other name of a file keeps its bytes.
        assert_eq!(std::fs::read(at("hard.mcap")).unwrap(), b"a");
    }
}
