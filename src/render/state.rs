//! The state of a picture: all that a renderer needs to go on with it as if it had never stopped.

/// The state of a picture between two batches. It belongs to one scene, one set of settings and one version.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RenderState {
    /// Number of the picture's first sample in the sequence, from 0.
    pub first: u64,
    /// Number of the next sample.
    pub next: u64,
    /// Values that were not finite so far.
    pub non_finite: u64,
    /// The converged tiles, if sampling is adaptive.
    pub tiles: Option<TileState>,
    /// The frames of a denoised picture.
    pub frames: Option<FrameState>,
    /// Contents of buffers: sums of samples, and histories. They are stored apart.
    #[serde(skip)]
    pub buffers: Vec<Vec<u8>>,
}

/// The state of [`super::adaptive_sampling::ConvergedTiles`].
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TileState {
    /// True for each tile that takes no more samples.
    pub converged: Vec<bool>,
    /// Samples of each tile when the mask was last written.
    pub taken: Vec<u64>,
    /// Samples of the picture at that time.
    pub since: u64,
}

/// The state of a picture that is denoised frame by frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrameState {
    /// Frames so far.
    pub frame: u64,
    /// Frames since anything changed.
    pub still: u64,
    /// Frames of these that precede the picture's first.
    pub first: u64,
    /// `clip_from_world` and position within the pixel of the frame before.
    pub before: Option<([[f32; 4]; 4], [f32; 2])>,
}
