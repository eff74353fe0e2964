//! The side of drag and drop that a file manager has (the XDND protocol, version 5).

use std::path::Path;

use x11rb::COPY_DEPTH_FROM_PARENT;
use x11rb::CURRENT_TIME;
use x11rb::connection::Connection as _;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    ClientMessageEvent, ConnectionExt as _, CreateWindowAux, EventMask, PropMode, SELECTION_NOTIFY_EVENT,
    SelectionNotifyEvent, SelectionRequestEvent, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// Whoever offers a file.
struct Source {
    connection: RustConnection,
    window: u32,
    target: u32,
    list: Vec<u8>,
}

/// Drops a file on a window of a display, and returns once the window has taken it.
pub fn drop_file(display: &str, target: u32, path: &Path) {
    let (connection, screen) = x11rb::connect(Some(display)).unwrap();
    let root = connection.setup().roots[screen].root;
    let window = connection.generate_id().unwrap();
    let (class, none) = (WindowClass::INPUT_OUTPUT, CreateWindowAux::new());
    connection.create_window(COPY_DEPTH_FROM_PARENT, window, root, 0, 0, 1, 1, 0, class, 0, &none).unwrap();
    let list = format!("file://{}\r\n", path.display().to_string().replace(' ', "%20")).into_bytes();
    let source = Source { connection, window, target, list };

    let [selection, uris, copy] = ["XdndSelection", "text/uri-list", "XdndActionCopy"].map(|name| source.atom(name));
    source.connection.set_selection_owner(window, selection, CURRENT_TIME).unwrap();
    source.tell("XdndEnter", [5 << 24, uris, 0, 0]);
    let place = source.connection.translate_coordinates(target, root, 50, 50).unwrap().reply().unwrap();
    let place = (place.dst_x as u32) << 16 | place.dst_y as u32;
    source.tell("XdndPosition", [0, place, CURRENT_TIME, copy]);
    let accepted = source.wait_for("XdndStatus")[1] & 1;
    assert_eq!(accepted, 1, "the window refuses the file");
    source.tell("XdndDrop", [0, CURRENT_TIME, 0, 0]);
    source.wait_for("XdndFinished");
}

impl Source {
    fn atom(&self, name: &str) -> u32 {
        self.connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom
    }

    fn tell(&self, kind: &str, [a, b, c, d]: [u32; 4]) {
        let message = ClientMessageEvent::new(32, self.target, self.atom(kind), [self.window, a, b, c, d]);
        self.connection.send_event(false, self.target, EventMask::NO_EVENT, message).unwrap();
        self.connection.flush().unwrap();
    }

    /// Answers what the window asks, until it says something of that kind.
    fn wait_for(&self, kind: &str) -> [u32; 5] {
        let kind = self.atom(kind);
        loop {
            match self.connection.wait_for_event().unwrap() {
                Event::SelectionRequest(request) => self.hand_over(&request),
                Event::ClientMessage(message) if message.type_ == kind => return message.data.as_data32(),
                _ => {}
            }
        }
    }

    fn hand_over(&self, request: &SelectionRequestEvent) {
        let SelectionRequestEvent { requestor, property, selection, target, time, .. } = *request;
        self.connection.change_property8(PropMode::REPLACE, requestor, property, target, &self.list).unwrap();
        let response_type = SELECTION_NOTIFY_EVENT;
        let answer = SelectionNotifyEvent { response_type, sequence: 0, time, requestor, selection, target, property };
        self.connection.send_event(false, requestor, EventMask::NO_EVENT, answer).unwrap();
        self.connection.flush().unwrap();
    }
}
