//! The media controller: which parts a device has, and the nodes they are reached by.

use super::{Node, Plain, Request, plain, text};
use std::{
    io,
    path::{Path, PathBuf},
};
use v4l::v4l2::vidioc::_IOC_TYPE as Code;

/// Function of an entity that is a flash lamp (`MEDIA_ENT_F_FLASH`).
pub(crate) const FLASH: u32 = 0x0002_0002;

/// Parts and nodes in one device; a graph beyond this is not believed.
const MOST: u32 = 1024;

/// `struct media_v2_entity` of `linux/media.h`.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct RawEntity {
    id: u32,
    name: [u8; 64],
    function: u32,
    flags: u32,
    reserved: [u32; 5],
}

/// `struct media_v2_interface`, with the union spelled as its longest member.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct RawInterface {
    id: u32,
    kind: u32,
    flags: u32,
    reserved: [u32; 9],
    /// Major and minor number of the node, then nothing.
    node: [u32; 16],
}

/// `struct media_v2_link`.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct RawLink {
    id: u32,
    source: u32,
    sink: u32,
    flags: u32,
    reserved: [u32; 6],
}

/// One list of `struct media_v2_topology`: how many, and where.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct List {
    count: u32,
    reserved: u32,
    pointer: u64,
}

/// `struct media_v2_topology`.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct Topology {
    version: u64,
    entities: List,
    interfaces: List,
    pads: List,
    links: List,
}

plain!(RawEntity, RawInterface, RawLink, List, Topology);

/// `MEDIA_IOC_G_TOPOLOGY`: `_IOWR('|', 0x04, struct media_v2_topology)`.
const TOPOLOGY: Request<Topology> = Request::new(0xc048_7c04 as Code);

/// The name and the node of every part with this function, of every media device there is.
pub(crate) fn nodes_with_function(function: u32) -> Vec<(String, PathBuf)> {
    let Ok(folder) = std::fs::read_dir("/dev") else {
        return Vec::new();
    };
    let mut devices: Vec<PathBuf> = folder
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("media"))
        .map(|entry| entry.path())
        .collect();
    devices.sort();
    devices
        .iter()
        .filter_map(|path| Node::open(path).ok())
        .filter_map(|device| device.parts_with_function(function).ok())
        .flatten()
        .collect()
}

impl Node {
    fn parts_with_function(&self, function: u32) -> io::Result<Vec<(String, PathBuf)>> {
        let mut sizes = Topology::zero();
        // SAFETY: all pointers are null, so the kernel only counts.
        unsafe { self.request(&TOPOLOGY, &mut sizes)? };
        let (entities, interfaces, links) = (
            sizes.entities.count,
            sizes.interfaces.count,
            sizes.links.count,
        );
        if entities.max(interfaces).max(links) > MOST {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let mut entities = vec![RawEntity::zero(); entities as usize];
        let mut interfaces = vec![RawInterface::zero(); interfaces as usize];
        let mut links = vec![RawLink::zero(); links as usize];
        let mut whole = Topology {
            entities: list(&mut entities),
            interfaces: list(&mut interfaces),
            links: list(&mut links),
            ..Plain::zero()
        };
        // SAFETY: each list points to a vector of as many elements as its count says, alive until
        // after the call; the kernel answers ENOSPC when it has more, and writes none beyond.
        unsafe { self.request(&TOPOLOGY, &mut whole)? };
        Ok(entities
            .iter()
            .filter(|entity| entity.function == function)
            .filter_map(|entity| {
                // An interface's link leads from the node to the part it controls.
                let id = entity.id;
                let node = links
                    .iter()
                    .filter(|link| link.sink == id)
                    .find_map(|link| interfaces.iter().find(|found| found.id == link.source))?;
                let [major, minor, ..] = node.node;
                let name = entity.name;
                Some((text(&name), path_of(major, minor)?))
            })
            .collect())
    }
}

fn list<T>(elements: &mut [T]) -> List {
    List {
        count: elements.len() as u32,
        reserved: 0,
        pointer: elements.as_mut_ptr() as u64,
    }
}

/// The path of a character device, as the kernel names it.
fn path_of(major: u32, minor: u32) -> Option<PathBuf> {
    let facts = std::fs::read_to_string(format!("/sys/dev/char/{major}:{minor}/uevent")).ok()?;
    let name = facts
        .lines()
        .find_map(|line| line.strip_prefix("DEVNAME="))?;
    Some(Path::new("/dev").join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_are_those_of_the_kernel_header() {
        // Sizes as a C compiler gives them for linux/media.h.
        assert_eq!(size_of::<RawEntity>(), 96);
        assert_eq!(size_of::<RawInterface>(), 112);
        assert_eq!(size_of::<RawLink>(), 40);
        assert_eq!(size_of::<Topology>(), 72);
    }
}
