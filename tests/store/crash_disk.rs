//! A disk in memory that forgets, when power is lost, what was not synced.
//!
//! The model is as mean as POSIX allows: every change of a folder's entries and every write that no
//! sync has covered may or may not have reached the disk, each by itself and in any order; a write
//! may have reached it in part, as zeroes or as garbage. A sync of a file covers its contents, not
//! its name; a sync of a folder covers its entries, not what they point to.

use captured::output::{FileSystem, NewFile};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard},
};

type Inode = usize;

#[derive(Clone, Debug)]
enum Node {
    File { now: Vec<u8>, durable: Vec<u8> },
    Folder { now: Entries, durable: Entries },
}

type Entries = BTreeMap<String, Inode>;

/// What a deliberately broken disk (or a commit that forgot it) leaves out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Broken {
    /// Files are not synced before the folder gets its name.
    FileSync,
    /// The unfinished folder is not synced before it gets its name.
    FolderSync,
    /// A rename is not synced before it is acknowledged.
    ParentSync,
    /// Instead of one rename, entries are moved one by one.
    Rename,
}

#[derive(Clone)]
struct Inner {
    nodes: Vec<Node>,
    /// Steps until power is lost; `None` = never.
    left: Option<usize>,
    steps: usize,
    broken: Option<Broken>,
}

/// The disk.
pub struct CrashDisk(Mutex<Inner>);

/// The kind of error with which everything fails once power is lost.
const LOST: io::ErrorKind = io::ErrorKind::NotConnected;

impl CrashDisk {
    /// An empty disk with a folder `/shots`.
    pub fn new(broken: Option<Broken>) -> Self {
        let empty = || Node::Folder {
            now: Entries::new(),
            durable: Entries::new(),
        };
        let root = Entries::from([("shots".to_owned(), 1)]);
        let root = Node::Folder {
            now: root.clone(),
            durable: root,
        };
        Self(Mutex::new(Inner {
            nodes: vec![root, empty()],
            left: None,
            steps: 0,
            broken,
        }))
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap()
    }

    /// Loses power after so many more steps.
    pub fn lose_power_after(&self, steps: usize) {
        self.inner().left = Some(steps);
    }

    /// Steps so far.
    pub fn steps(&self) -> usize {
        self.inner().steps
    }

    /// The disk as it may be found when power is back; `choose` answers each "did it arrive?".
    pub fn after_power_loss(&self, choose: &mut dyn FnMut() -> u32) -> Self {
        let mut inner = self.inner().clone();
        for node in &mut inner.nodes {
            match node {
                Node::File { now, durable } => {
                    if now != durable {
                        *durable = torn(durable, now, choose);
                    }
                    *now = durable.clone();
                }
                Node::Folder { now, durable } => *now = arrived(now, durable, choose),
            }
            if let Node::Folder { now, durable } = node {
                durable.clone_from(now);
            }
        }
        inner.left = None;
        inner.broken = None;
        Self(Mutex::new(inner))
    }

    /// The disk as the next process finds it when this one was killed and power stayed.
    pub fn after_kill(&self) -> Self {
        let mut inner = self.inner().clone();
        inner.left = None;
        Self(Mutex::new(inner))
    }
}

/// Entries of which each may have arrived or not. A rename within a folder arrives as one: never
/// under both names, never under none.
fn arrived(now: &Entries, durable: &Entries, choose: &mut dyn FnMut() -> u32) -> Entries {
    let name_of = |entries: &Entries, inode: Inode| {
        let found = entries.iter().find(|(_, found)| **found == inode);
        found.map(|(name, _)| name.clone())
    };
    let inodes: BTreeSet<Inode> = now.values().chain(durable.values()).copied().collect();
    let mut entries = Entries::new();
    for inode in inodes {
        let (new, old) = (name_of(now, inode), name_of(durable, inode));
        let name = if new == old || choose().is_multiple_of(2) {
            old
        } else {
            new
        };
        if let Some(name) = name {
            entries.insert(name, inode);
        }
    }
    entries
}

/// Contents of which an unknown part arrived.
fn torn(durable: &[u8], now: &[u8], choose: &mut dyn FnMut() -> u32) -> Vec<u8> {
    match choose() % 5 {
        0 => durable.to_vec(),
        1 => now.to_vec(),
        2 => now[..now.len().min(choose() as usize % (now.len() + 1))].to_vec(),
        3 => vec![0; now.len()],
        _ => {
            let mut garbled = now.to_vec();
            let from = choose() as usize % (now.len() + 1);
            for byte in &mut garbled[from..] {
                *byte = !*byte;
            }
            garbled
        }
    }
}

impl Inner {
    /// One step of the disk; fails once power is lost.
    fn step(&mut self) -> io::Result<()> {
        match &mut self.left {
            Some(0) => return Err(LOST.into()),
            Some(left) => *left -= 1,
            None => {}
        }
        self.steps += 1;
        Ok(())
    }

    fn find(&self, path: &Path) -> Option<Inode> {
        let mut at = 0;
        for part in path.components().skip(1) {
            let Node::Folder { now, .. } = &self.nodes[at] else {
                return None;
            };
            at = *now.get(part.as_os_str().to_str().unwrap())?;
        }
        Some(at)
    }

    fn inode(&self, path: &Path) -> io::Result<Inode> {
        self.find(path)
            .ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn entries(&mut self, folder: &Path) -> io::Result<&mut Entries> {
        let inode = self.inode(folder)?;
        match &mut self.nodes[inode] {
            Node::Folder { now, .. } => Ok(now),
            Node::File { .. } => Err(io::ErrorKind::NotADirectory.into()),
        }
    }

    fn add(&mut self, path: &Path, node: Node) -> io::Result<Inode> {
        if self.find(path).is_some() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        let inode = self.nodes.len();
        let (parent, name) = parts(path);
        self.entries(&parent)?.insert(name, inode);
        self.nodes.push(node);
        Ok(inode)
    }

    fn rename(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        let inode = self.inode(from)?;
        let (parent, name) = parts(to);
        self.entries(&parent)?.insert(name, inode);
        let (parent, name) = parts(from);
        self.entries(&parent)?.remove(&name);
        Ok(())
    }
}

fn parts(path: &Path) -> (PathBuf, String) {
    let name = path.file_name().unwrap().to_str().unwrap().to_owned();
    (path.parent().unwrap().to_owned(), name)
}

struct Writing<'a> {
    disk: &'a CrashDisk,
    inode: Inode,
}

impl Write for Writing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut inner = self.disk.inner();
        inner.step()?;
        // Short, so that whoever writes must go on.
        let taken = bytes.len().min(400);
        if let Node::File { now, .. } = &mut inner.nodes[self.inode] {
            now.extend_from_slice(&bytes[..taken]);
        }
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl NewFile for Writing<'_> {
    fn sync(&mut self) -> io::Result<()> {
        let mut inner = self.disk.inner();
        inner.step()?;
        if inner.broken == Some(Broken::FileSync) {
            return Ok(());
        }
        if let Node::File { now, durable } = &mut inner.nodes[self.inode] {
            durable.clone_from(now);
        }
        Ok(())
    }
}

impl FileSystem for CrashDisk {
    fn create_dir(&self, dir: &Path) -> io::Result<()> {
        let mut inner = self.inner();
        inner.step()?;
        let empty = Node::Folder {
            now: Entries::new(),
            durable: Entries::new(),
        };
        inner.add(dir, empty).map(drop)
    }

    fn create_file<'a>(&'a self, file: &Path) -> io::Result<Box<dyn NewFile + 'a>> {
        let mut inner = self.inner();
        inner.step()?;
        let empty = Node::File {
            now: Vec::new(),
            durable: Vec::new(),
        };
        let inode = inner.add(file, empty)?;
        Ok(Box::new(Writing { disk: self, inode }))
    }

    fn open<'a>(&'a self, file: &Path) -> io::Result<(u64, Box<dyn Read + 'a>)> {
        let inner = self.inner();
        match &inner.nodes[inner.inode(file)?] {
            Node::File { now, .. } => {
                Ok((now.len() as u64, Box::new(io::Cursor::new(now.clone()))))
            }
            Node::Folder { .. } => Ok((0, Box::new(io::empty()))),
        }
    }

    fn sync_file(&self, file: &Path) -> io::Result<()> {
        let mut inner = self.inner();
        inner.step()?;
        let inode = inner.inode(file)?;
        if let Node::File { now, durable } = &mut inner.nodes[inode] {
            durable.clone_from(now);
        }
        Ok(())
    }

    fn sync_dir(&self, dir: &Path) -> io::Result<()> {
        let mut inner = self.inner();
        inner.step()?;
        let inode = inner.inode(dir)?;
        let omitted = if inode == 1 {
            Broken::ParentSync
        } else {
            Broken::FolderSync
        };
        if inner.broken == Some(omitted) {
            return Ok(());
        }
        if let Node::Folder { now, durable } = &mut inner.nodes[inode] {
            durable.clone_from(now);
        }
        Ok(())
    }

    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut inner = self.inner();
        inner.step()?;
        if inner.find(to).is_some() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        if inner.broken == Some(Broken::Rename) && inner.entries(from).is_ok() {
            let names: Vec<String> = inner.entries(from)?.keys().cloned().collect();
            let empty = Node::Folder {
                now: Entries::new(),
                durable: Entries::new(),
            };
            inner.add(to, empty)?;
            for name in names {
                inner.step()?;
                inner.rename(&from.join(&name), &to.join(&name))?;
            }
            return Ok(());
        }
        inner.rename(from, to)
    }

    fn rename_over_empty(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut inner = self.inner();
        inner.step()?;
        inner.rename(from, to)
    }

    fn exchange(&self, _: &Path, _: &Path) -> io::Result<()> {
        unreachable!("a store replaces nothing")
    }

    fn remove(&self, dir: &Path) -> io::Result<()> {
        let names = self.list(dir)?.unwrap_or_default();
        for name in names {
            self.remove_file(&dir.join(name))?;
        }
        self.remove_file(dir)
    }

    fn remove_file(&self, file: &Path) -> io::Result<()> {
        let mut inner = self.inner();
        inner.step()?;
        inner.inode(file)?;
        let (parent, name) = parts(file);
        inner.entries(&parent)?.remove(&name);
        Ok(())
    }

    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>> {
        let mut inner = self.inner();
        match inner.entries(dir) {
            Ok(entries) => Ok(Some(entries.keys().cloned().collect())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        Ok(1 << 40)
    }
}
