//! Triangles: each by the edge that it shares with one of the last fifteen, where it does.

use crate::leb128::{append, folded};
use pixmesh_meshing::Face;

/// First byte of the stream: its kind and version 1.
const HEADER: u8 = 0xE1;

/// Pairs of vertex codes that come often, at the stream's end; the last two are padding.
const PAIRS: [u8; 16] =
    [0x00, 0x76, 0x87, 0x56, 0x67, 0x78, 0xA9, 0x86, 0x65, 0x89, 0x68, 0x98, 0x01, 0x69, 0, 0];

/// Pairs that can be named.
const PAIR_COUNT: usize = 14;

/// Code of a vertex by its index, after an edge: what is less names recent vertices.
const NEAR_INDEX: u32 = 13;

/// Code of a vertex whose index follows among the data.
const EXPLICIT: u32 = 15;

/// Compresses triangles. They keep their order, but may begin with another corner.
pub(crate) fn compress_faces(faces: &[Face]) -> Vec<u8> {
    let mut encoder = Encoder::default();
    for &face in faces {
        match encoder.edges.find(face) {
            Some((age, turn)) => encoder.put_neighbour(age, rotated(face, turn)),
            None => {
                let turn = face.iter().position(|&v| v == encoder.next).unwrap_or(0);
                encoder.put_stranger(rotated(face, turn));
            }
        }
    }
    let mut stream = vec![HEADER];
    stream.append(&mut encoder.codes);
    stream.append(&mut encoder.data);
    stream.extend_from_slice(&PAIRS);
    stream
}

/// The triangle beginning with another corner.
fn rotated(mut face: Face, turn: usize) -> Face {
    face.rotate_left(turn);
    face
}

#[derive(Default)]
struct Encoder {
    /// A byte for each triangle.
    codes: Vec<u8>,
    /// What does not fit there.
    data: Vec<u8>,
    edges: Recent<(u32, u32)>,
    vertices: Recent<u32>,
    /// The least index that has not been used, where vertices are numbered by first use.
    next: u32,
    /// The last index that was written.
    last: u32,
}

impl Encoder {
    /// A triangle whose first edge is one of the recent ones.
    fn put_neighbour(&mut self, age: u32, [a, b, c]: Face) {
        let recent = self.vertices.age(c).filter(|age| (1..NEAR_INDEX).contains(age));
        let code = match recent {
            Some(age) => age,
            None => self.take_if_next(c).unwrap_or_else(|| self.index_code(c)),
        };
        self.codes.push((age << 4 | code) as u8);
        match code {
            EXPLICIT => self.put_index(c),
            NEAR_INDEX.. => self.last = c,
            _ => {}
        }
        if code == 0 || code >= NEAR_INDEX {
            self.vertices.push(c);
        }
        self.edges.push((c, b));
        self.edges.push((a, c));
    }

    /// A triangle that shares no recent edge. It begins with the next new vertex where it has that
    /// at all, so that new vertices in second and third place alone, which would mean that the
    /// numbers begin again, do not occur.
    fn put_stranger(&mut self, face: Face) {
        let [a, b, c] = face;
        let first = self.take_if_next(a).unwrap_or(EXPLICIT);
        let (second_age, third_age) = (self.vertices.age(b), self.vertices.age(c));
        let second = self.stranger_code(b, second_age);
        let third = self.stranger_code(c, third_age);
        let pair = (second << 4 | third) as u8;
        let named = PAIRS.iter().take(PAIR_COUNT).position(|&known| known == pair);
        match named.filter(|_| first == 0) {
            Some(index) => self.codes.push(0xF0 | index as u8),
            None => {
                self.codes.push(if first == 0 { 0xFE } else { 0xFF });
                self.data.push(pair);
            }
        }
        let codes = [first, second, third];
        for (vertex, code) in face.into_iter().zip(codes) {
            if code == EXPLICIT {
                self.put_index(vertex);
            }
        }
        for (vertex, code) in face.into_iter().zip(codes) {
            if code == 0 || code == EXPLICIT {
                self.vertices.push(vertex);
            }
        }
        self.edges.push((b, a));
        self.edges.push((c, b));
        self.edges.push((a, c));
    }

    /// Code of a stranger's second or third vertex: its age plus 1 where it is recent, 0 for the
    /// next new one.
    fn stranger_code(&mut self, vertex: u32, age: Option<u32>) -> u32 {
        match age.filter(|&age| age < PAIR_COUNT as u32) {
            Some(age) => age + 1,
            None => self.take_if_next(vertex).unwrap_or(EXPLICIT),
        }
    }

    /// 0 for the next new vertex, which is not new any more then.
    fn take_if_next(&mut self, vertex: u32) -> Option<u32> {
        (vertex == self.next).then(|| {
            self.next += 1;
            0
        })
    }

    /// Code of a vertex by its index: one before the last written, one after it, or any.
    fn index_code(&self, vertex: u32) -> u32 {
        if vertex.wrapping_add(1) == self.last {
            NEAR_INDEX
        } else if vertex == self.last.wrapping_add(1) {
            NEAR_INDEX + 1
        } else {
            EXPLICIT
        }
    }

    /// Appends the difference of an index to the last, seven bits a byte, the least first.
    fn put_index(&mut self, index: u32) {
        let delta = index.wrapping_sub(self.last);
        append(folded((delta as i32).into()), &mut self.data);
        self.last = index;
    }
}

/// The last sixteen of something.
#[derive(Default)]
struct Recent<T> {
    entries: [Option<T>; 16],
    /// Where the next goes.
    end: usize,
}

impl<T: Copy + PartialEq> Recent<T> {
    fn push(&mut self, entry: T) {
        self.entries[self.end] = Some(entry);
        self.end = (self.end + 1) % 16;
    }

    /// The entries from the latest on, with their ages.
    fn latest(&self) -> impl Iterator<Item = (u32, T)> {
        (0..16).filter_map(|age| Some((age as u32, self.entries[(self.end + 15 - age) % 16]?)))
    }

    /// How many were pushed after the entry.
    fn age(&self, entry: T) -> Option<u32> {
        self.latest().find(|&(_, other)| other == entry).map(|(age, _)| age)
    }
}

impl Recent<(u32, u32)> {
    /// The age of the latest edge that is one of the triangle's, under 15, and the corner it
    /// begins with.
    fn find(&self, [a, b, c]: Face) -> Option<(u32, usize)> {
        let sides = [(a, b), (b, c), (c, a)];
        self.latest().filter(|&(age, _)| age < 15).find_map(|(age, edge)| {
            let turn = sides.iter().position(|&side| side == edge)?;
            Some((age, turn))
        })
    }
}
