//! Live previews: sends a picture to a viewer while it is rendered, by the protocol of tev, which HDRView speaks, too.
//!
//! A packet begins with its length in bytes, itself included, and its kind. Numbers are little-endian, and text
//! ends with a zero.

use std::io::{self, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use crate::film::Film;

/// Kinds of packets.
const CREATE_IMAGE: u8 = 4;
const UPDATE_IMAGE: u8 = 6;

const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// Pixels along a side of a tile. A packet holds one.
const TILE: u32 = 128;

/// Time between two updates.
const EVERY: Duration = Duration::from_secs(1);

/// Time that a viewer has to accept a connection or a packet.
const PATIENCE: Duration = Duration::from_secs(2);

/// Checks that an address has a host and a port.
pub fn parse_address(text: &str) -> Result<String, &'static str> {
    let port = text.rsplit_once(':').filter(|(host, _)| !host.is_empty()).and_then(|(_, port)| port.parse().ok());
    let named = port.is_some_and(|port: u16| port != 0);
    if named { Ok(text.to_owned()) } else { Err("an address is HOST:PORT, such as localhost:14158, the port of tev") }
}

/// A picture in a viewer.
pub struct Preview {
    /// Name of the picture in the viewer.
    name: String,
    address: String,
    /// None after an error: then nothing more is sent.
    stream: Option<TcpStream>,
    /// What the viewer shows.
    shown: Film,
    sent: Option<Instant>,
}

impl Preview {
    /// Connects to a viewer. A note says if that fails, and the render goes on without a preview.
    pub fn connect(address: &str, name: String) -> Self {
        let (address, shown) = (address.to_owned(), Film::default());
        let mut this = Self { name, address, stream: None, shown, sent: None };
        match this.open() {
            Ok(stream) => this.stream = Some(stream),
            Err(error) => this.give_up(&error),
        }
        this
    }

    fn open(&self) -> io::Result<TcpStream> {
        let mut error = io::Error::new(io::ErrorKind::NotFound, "the host is unknown");
        for address in self.address.to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => {
                    stream.set_write_timeout(Some(PATIENCE))?;
                    return Ok(stream);
                }
                Err(refused) => error = refused,
            }
        }
        Err(error)
    }

    fn give_up(&mut self, error: &io::Error) {
        self.stream = None;
        eprintln!("note: --preview {}: {error}; the render goes on without it", self.address);
    }

    /// True if the viewer should see the picture as it is now.
    pub fn is_due(&self) -> bool {
        self.stream.is_some() && self.sent.is_none_or(|sent| sent.elapsed() >= EVERY)
    }

    /// Sends the tiles of a picture that have changed.
    pub fn show(&mut self, film: &Film) {
        let Some(mut stream) = self.stream.take() else { return };
        match self.send(&mut stream, film) {
            Ok(()) => self.stream = Some(stream),
            Err(error) => self.give_up(&error),
        }
        self.sent = Some(Instant::now());
    }

    fn send(&mut self, stream: &mut TcpStream, film: &Film) -> io::Result<()> {
        let size = [film.width, film.height];
        if size != [self.shown.width, self.shown.height] {
            stream.write_all(&create_image(&self.name, size))?;
            self.shown = Film::new(film.width, film.height);
        }
        for y in (0..film.height).step_by(TILE as usize) {
            for x in (0..film.width).step_by(TILE as usize) {
                let corner = [x, y];
                let pixels = tile(film, corner);
                if pixels != tile(&self.shown, corner) {
                    stream.write_all(&update_image(&self.name, corner, size, &pixels))?;
                }
            }
        }
        self.shown = film.clone();
        stream.flush()
    }
}

/// Returns columns and rows of the tile at a corner.
fn extent([x, y]: [u32; 2], [width, height]: [u32; 2]) -> [u32; 2] {
    [TILE.min(width - x), TILE.min(height - y)]
}

/// Returns the pixels of the tile at a corner.
fn tile(film: &Film, corner: [u32; 2]) -> Vec<[f32; 3]> {
    let [columns, rows] = extent(corner, [film.width, film.height]);
    let row = |y: u32| {
        let first = (y * film.width + corner[0]) as usize;
        film.pixels[first..first + columns as usize].iter().copied()
    };
    (corner[1]..corner[1] + rows).flat_map(row).collect()
}

/// Returns a packet that creates a black image and selects it.
fn create_image(name: &str, size: [u32; 2]) -> Vec<u8> {
    let mut packet = Packet::new(CREATE_IMAGE, true);
    packet.text(name);
    size.iter().for_each(|&side| packet.bytes(&side.to_le_bytes()));
    packet.channels();
    packet.finished()
}

/// Returns a packet that replaces a tile. Its pixels are interleaved: channel c begins at value c, and pixels are
/// three values apart.
fn update_image(name: &str, corner: [u32; 2], size: [u32; 2], pixels: &[[f32; 3]]) -> Vec<u8> {
    let mut packet = Packet::new(UPDATE_IMAGE, false);
    packet.text(name);
    packet.channels();
    corner.into_iter().chain(extent(corner, size)).for_each(|number| packet.bytes(&number.to_le_bytes()));
    let (offsets, strides) = ([0_i64, 1, 2], [3_i64; 3]);
    offsets.into_iter().chain(strides).for_each(|number| packet.bytes(&number.to_le_bytes()));
    pixels.iter().flatten().for_each(|value| packet.bytes(&value.to_le_bytes()));
    packet.finished()
}

/// A packet that is being written.
struct Packet(Vec<u8>);

impl Packet {
    fn new(kind: u8, grabs_focus: bool) -> Self {
        Self(vec![0, 0, 0, 0, kind, u8::from(grabs_focus)])
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    fn text(&mut self, text: &str) {
        self.0.extend(text.bytes().filter(|&byte| byte != 0).chain([0]));
    }

    /// Adds number and names of the channels.
    fn channels(&mut self) {
        self.bytes(&(CHANNELS.len() as u32).to_le_bytes());
        CHANNELS.iter().for_each(|name| self.text(name));
    }

    fn finished(mut self) -> Vec<u8> {
        let length = self.0.len() as u32;
        self.0[..4].copy_from_slice(&length.to_le_bytes());
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_have_the_layout_of_tev() {
        let created = create_image("a", [2, 1]);
        let channels = [3, 0, 0, 0, b'R', 0, b'G', 0, b'B', 0];
        assert_eq!(created, [&[26, 0, 0, 0, 4, 1, b'a', 0, 2, 0, 0, 0, 1, 0, 0, 0][..], &channels].concat());
        let updated = update_image("a", [0, 0], [1, 1], &[[1.0, 2.0, -0.5]]);
        let place = [0, 0, 1, 1].map(u32::to_le_bytes).concat();
        let numbers = [0_i64, 1, 2, 3, 3, 3].map(i64::to_le_bytes).concat();
        let values = [1.0_f32, 2.0, -0.5].map(f32::to_le_bytes).concat();
        assert_eq!(updated, [&[94, 0, 0, 0, 6, 0, b'a', 0][..], &channels, &place, &numbers, &values].concat());
    }

    #[test]
    fn addresses_have_a_port() {
        for good in ["localhost:14158", "[::1]:1", "10.0.0.1:65535"] {
            assert!(parse_address(good).is_ok(), "{good}");
        }
        for bad in ["", "localhost", ":14158", "a:0", "a:65536", "a:b"] {
            assert!(parse_address(bad).is_err(), "{bad}");
        }
    }
}
