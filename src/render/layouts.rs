//! Structs and constants that Rust and shaders share. `tests/layouts.rs` compares names, offsets, sizes and
//! values with the shaders.

use bytemuck::{Pod, Zeroable};

use crate::gpu::Flag;

macro_rules! layouts {
    ($($(#[$doc:meta])* struct $name:ident in $shader:literal { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
            #[allow(missing_docs, reason = "the shader's struct of the same name documents its fields")]
            pub struct $name { $($(#[$field_doc])* pub $field: $type,)* }
        )*

        /// Returns for each struct its name, a shader module that holds it, its size, and its fields with
        /// their offsets.
        #[must_use]
        pub fn all() -> Vec<(&'static str, &'static str, usize, Vec<(&'static str, usize)>)> {
            vec![$((
                stringify!($name),
                $shader,
                size_of::<$name>(),
                vec![$((stringify!($field), std::mem::offset_of!($name, $field)),)*],
            )),*]
        }
    };
}

layouts! {
    /// Attributes of a vertex other than its position. Without textures the last two fields are absent.
    struct Attributes in "shared/paths/connect" {
        normal: [f32; 3],
        color: u32,
        tangent: [f32; 4],
        uv: [f32; 4],
    }

    /// Corners and material of a triangle.
    struct Triangle in "shared/paths/connect" {
        vertices: [u32; 3],
        material: u32,
    }

    /// A vertex in the rest pose.
    struct RestVertex in "upload/deform" {
        position: [f32; 3],
        instance: u32,
        normal: [f32; 3],
        joints_begin: u32,
        tangent: [f32; 4],
        joints_end: u32,
        morph: u32,
        pad: [u32; 2],
    }

    /// The source of a posed vertex.
    struct Origin in "upload/deform" {
        corners: [u32; 3],
        source: u32,
    }

    /// The division of the scene's box into cells.
    struct Grid in "visibility/grid_build/grid_triangles" {
        low: [f32; 3],
        scale: f32,
        size: [u32; 3],
        lists: u32,
        listed: u32,
        triangles: u32,
        words: u32,
        sub_cells: f32,
    }

    /// The axis along which distances of empty cells are found.
    struct Axis in "visibility/grid_build/grid_distances" {
        axis: u32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }

    /// An instance in its pose.
    struct PosedInstance in "upload/deform" {
        world_from_local: [[f32; 4]; 3],
        matrices: u32,
        weights: u32,
        targets: u32,
        vertices: u32,
    }

    /// A joint that influences a vertex.
    struct Joint in "upload/deform" {
        index: u32,
        weight: f32,
    }

    /// The offsets that a morph target adds to a vertex.
    struct MorphOffset in "upload/deform" {
        position: [f32; 4],
        normal: [f32; 4],
        tangent: [f32; 4],
    }

    /// The source of a control vertex of a tessellated mesh.
    struct ControlOrigin in "upload/controls" {
        uv: [f32; 4],
        source: u32,
        place: u32,
        members_begin: u32,
        members_end: u32,
        color: u32,
        surface: u32,
        pad: [u32; 2],
    }

    /// A posed control vertex; the host only needs its size.
    struct Control in "upload/controls" {
        place: [f32; 3],
        surface: u32,
        direction: [f32; 3],
        color: u32,
        normal: [f32; 3],
        pad0: u32,
        rest: [f32; 3],
        pad1: u32,
        tangent: [f32; 4],
        uv: [f32; 4],
    }

    /// A new vertex of a tessellated mesh, as a blend of control vertices.
    struct Blend in "upload/tessellate" {
        corners: [u32; 3],
        y: f32,
        heights: [u32; 3],
        z: f32,
    }

    /// The range of new vertices of tessellated meshes.
    struct NewVertices in "upload/tessellate" {
        first: u32,
        count: u32,
        pad0: u32,
        pad1: u32,
    }

    /// The tessellation and displacement of a surface.
    struct Refinement in "upload/tessellate" {
        drift: [f32; 3],
        kind: u32,
        shape: f32,
        scale: f32,
        bias: f32,
        frequency: f32,
        first: u32,
        count: u32,
        seed: u32,
        uv_set: u32,
        size: [i32; 2],
        wrap: [u32; 2],
    }

    /// A wave that displaces a surface.
    struct Wave in "upload/tessellate" {
        cycles: [f32; 3],
        amplitude: f32,
        phase: f32,
        pad0: f32,
        pad1: f32,
        pad2: f32,
    }

    /// A material.
    struct Material in "shared/paths/connect" {
        base: [f32; 3],
        model: u32,
        specular: [f32; 3],
        flags: u32,
        eta: [f32; 3],
        roughness: f32,
        k: [f32; 3],
        metallic: f32,
        emission: [f32; 3],
        specular_factor: f32,
        mask_value: f32,
        mask_cutoff: f32,
        first_use: u32,
        end_use: u32,
        emission_texture: u32,
        mask_texture: u32,
        parts: [u32; 2],
        absorption: [f32; 3],
        transmission: f32,
    }

    /// The first rows of tables, in the buffer that holds all of them.
    struct TableRows in "shared/paths/connect" {
        triangles: u32,
        materials: u32,
        layers: u32,
        texture_uses: u32,
        sheen_albedos: u32,
        lights: u32,
        light_sums: u32,
        emitters: u32,
        patterns: u32,
        sky_shares: u32,
        light_nodes: u32,
        rough_coats: u32,
        columns_shift: u32,
        aims: u32,
        aimed: u32,
        aim_densities: u32,
    }

    /// Layers on top of a material.
    struct Layers in "subpaths/eye_paths" {
        coat: f32,
        coat_roughness: f32,
        anisotropy_direction: [f32; 2],
        sheen: [f32; 3],
        sheen_roughness: f32,
        film_thickness: [f32; 2],
        film: f32,
        film_ior: f32,
        diffuse_transmission_color: [f32; 3],
        diffuse_transmission: f32,
        anisotropy: f32,
        disney_sheen: f32,
        disney_sheen_tint: f32,
        flatness: f32,
    }

    /// One use of a texture by a material.
    struct TextureUse in "shared/paths/connect" {
        row_u: [f32; 3],
        layer: u32,
        row_v: [f32; 3],
        flags: u32,
        origin: [f32; 2],
        size: [f32; 2],
        purposes: u32,
        channels: u32,
        scale: f32,
        pad: u32,
    }

    /// The projection of a view.
    struct View in "shared/views/view_setup" {
        origin: [f32; 3],
        kind: u32,
        right: [f32; 3],
        exclude: u32,
        up: [f32; 3],
        scale: f32,
        forward: [f32; 3],
        resolution: u32,
        normal: [f32; 3],
        slabs: u32,
    }

    /// The uniform that the passes of an iteration share.
    struct FrameUniform in "shared/paths/connect" {
        clip_from_world: [[f32; 4]; 4],
        camera_position: [f32; 3],
        orthographic: u32,
        camera_right: [f32; 3],
        width: u32,
        camera_up: [f32; 3],
        height: u32,
        camera_forward: [f32; 3],
        samples: f32,
        jitter: [f32; 2],
        y1_random: [f32; 2],
        y2_random: [f32; 2],
        beta: f32,
        iteration: u32,
        noise: u32,
        columns: u32,
        first: [u32; 2],
        rows: u32,
        stride: u32,
        scale: u32,
        layers: u32,
        seed: u32,
        number: u32,
        splat_scale: f32,
        bounces: u32,
        specular_bounces: u32,
        offset: u32,
        slot: u32,
        first_light_point: u32,
        sharp_alpha: f32,
        camera_number: u32,
        pad0: [u32; 2],
        pad1: [u32; 4],
    }

    /// A strategy's constants.
    struct Strategy in "shared/paths/connect" {
        sample_counts: [f32; 4],
        s: u32,
        j: u32,
        clamp_distance: f32,
        clear: u32,
        narrow_only: u32,
        light_points: u32,
        lights: u32,
        own_sky: u32,
    }

    /// Requests and capacities of a view.
    struct ListRequest in "shared/film/accumulate" {
        items: u32,
        nodes: u32,
        item_capacity: u32,
        node_capacity: u32,
    }

    /// The uniform that the passes over paths share.
    struct Paths in "subpaths/eye_paths" {
        seed: u32,
        number: u32,
        first: u32,
        count: u32,
        lens_radius: f32,
        focus: f32,
        only_s: u32,
        only_t: u32,
        unweighted: u32,
        tree_lights: u32,
        tree_share: f32,
        biased_reuse: u32,
        memory: f32,
    }

    /// Constants of all lights.
    struct Lighting in "subpaths/eye_paths" {
        environment_from_world: [[f32; 4]; 3],
        environment: [f32; 3],
        environment_rows_at_poles: u32,
        center: [f32; 3],
        radius: f32,
        half_extent: [f32; 3],
        light_count: u32,
        environment_probability: f32,
        environment_integral: f32,
        environment_bands: u32,
        environment_columns: u32,
    }

    /// A light of the light table.
    struct LightRecord in "subpaths/eye_paths" {
        position: [f32; 3],
        kind: u32,
        direction: [f32; 3],
        probability: f32,
        intensity: [f32; 3],
        triangle: u32,
        inner_versine: f32,
        outer_versine: f32,
        falloff: u32,
        trail: u32,
        right: [f32; 3],
        radius: f32,
    }

    /// A node of the light tree.
    struct LightNode in "subpaths/eye_paths" {
        center: [f32; 3],
        radius2: f32,
        strength: f32,
        child: u32,
        axis: u32,
        cosines: u32,
    }

    /// A vertex of a light subpath of `bdpt`; the host only needs its size.
    struct PathVertex in "subpaths/light_paths" {
        throughput: [f32; 3],
        triangle: u32,
        wi: [f32; 3],
        p: f32,
        barycentric: [f32; 2],
        d: f32,
        c: f32,
    }

    /// A reservoir with a resampled light sample; the host only needs its size.
    struct Reservoir in "subpaths/reservoirs" {
        light: u32,
        confidence: f32,
        u: [f32; 2],
        weight: f32,
        target_pdf: f32,
        pad0: f32,
        pad1: f32,
    }

    /// The first hit of a pixel's path, with its reservoir; the host only needs its size.
    struct FirstHit in "subpaths/reservoirs" {
        wo: [f32; 3],
        triangle: u32,
        barycentric: [f32; 2],
        distance: f32,
        pad: f32,
        reservoir: Reservoir,
    }

    /// The light of a light point, and the random numbers of its position.
    struct LightStart in "shared/light/light_point" {
        random: [f32; 2],
        light: u32,
        pad: u32,
    }

    /// A line along which a path from the view found light of the sky.
    struct FoundLine in "shared/light/sky_guide" {
        w: [f32; 3],
        value: f32,
        offset: [f32; 3],
        vertex: u32,
    }

    /// A point on a light, at which a light subpath starts.
    struct LightPoint in "shared/light/light_point" {
        position: [f32; 3],
        kind: u32,
        direction: [f32; 3],
        triangle: u32,
        value: [f32; 3],
        p: f32,
        index: u32,
        traits: u32,
        inner_versine: f32,
        outer_versine: f32,
    }

    /// A vertex of the light subpath; the host only needs its size.
    struct LightVertex in "shared/paths/connect" {
        position: [f32; 3],
        triangle: u32,
        ng: [f32; 3],
        pdf_a: f32,
        throughput: [f32; 3],
        r1: f32,
        wi: [f32; 3],
        pdf_a_from_w: f32,
        bsdf: [[f32; 4]; 5],
        q0: f32,
        own_sky: f32,
        pad0: f32,
        pad1: f32,
    }

    /// A vertex of an eye subpath; the host only needs its size.
    struct EyeVertex in "shared/paths/connect" {
        position: [f32; 3],
        triangle: u32,
        throughput: [f32; 3],
        pdf_a_forward: f32,
        wo: [f32; 3],
        pdf_a_from_w: f32,
        pdf_a_from_w_prev: f32,
        pdf_a_forward_prev: f32,
        barycentric: [f32; 2],
    }

    /// The light candidate that a pixel selected.
    struct SelectedLight in "shared/light/light_candidates" {
        value: [f32; 3],
        light_point: u32,
    }

    /// The eye vertex z1 of a pixel and its reservoir; the host only needs its size.
    struct PixelReservoir in "shared/light/light_reservoirs" {
        wo: [f32; 3],
        triangle: u32,
        barycentric: [f32; 2],
        light_point: u32,
        weight: f32,
    }

    /// Constants of the reuse of reservoirs.
    struct Reuse in "shared/light/light_reservoirs" {
        has_past: u32,
        biased: u32,
    }

    /// The surface that a pixel sees, as the filters compare it.
    struct Guide in "denoise/temporal" {
        position: [f32; 3],
        triangle: u32,
        normal: [f32; 3],
        shown_x: f32,
        shown_yz: [f32; 2],
        reflectance: [u32; 2],
    }

    /// The uniform that the passes of the denoiser share.
    struct DenoiseUniform in "denoise/temporal" {
        clip_before: [[f32; 4]; 4],
        camera_position: [f32; 3],
        footprint: f32,
        jitter_shift: [f32; 2],
        image: [u32; 2],
        layer: [u32; 2],
        repeated: [u32; 2],
        scale: u32,
        side: u32,
        orthographic: u32,
        has_before: u32,
        still: u32,
        moved: u32,
        repeats: u32,
        history: f32,
        odd: u32,
        averages: f32,
        frames: f32,
        clamped_alpha: f32,
    }

    /// The BSDF of a pixel's eye vertex. Without glossy materials the last two fields are absent. The host
    /// only needs its size.
    struct Shading in "shared/paths/connect" {
        ng: [f32; 3],
        material: u32,
        ns: [f32; 3],
        alpha: f32,
        diffuse: [f32; 3],
        metallic: f32,
        specular: [f32; 3],
        f90: f32,
    }
}

impl Attributes {
    /// Returns the bytes per vertex.
    #[must_use]
    pub fn bytes(textured: bool) -> usize {
        if textured { size_of::<Self>() } else { std::mem::offset_of!(Self, tangent) }
    }
}

impl LightVertex {
    /// Returns the bytes of a vertex in shaders with these flags. Its BSDF ends with those of layers.
    #[must_use]
    pub fn bytes(flags: &[Flag]) -> usize {
        let bytes = |flag, bytes: usize| if flags.contains(&flag) { bytes } else { 0 };
        size_of::<Self>()
            + bytes(Flag::DiffuseTransmission, 16)
            + bytes(Flag::Film, 16)
            + bytes(Flag::Anisotropy, 16)
            + bytes(Flag::Disney, 16)
            + bytes(Flag::Sheen, 16)
            + bytes(Flag::Coat, 32)
    }
}

impl EyeVertex {
    /// Returns the bytes per pixel. With `demodulated` a vertex holds the part of the throughput that the
    /// diffuse base of z1 contributes, with `transmits` the medium before it, with `caustics` the densities of
    /// light paths, in one word.
    #[must_use]
    pub fn bytes(demodulated: bool, transmits: bool, caustics: bool) -> u64 {
        // Three words of each of the others take four.
        let alone = caustics && !demodulated && !transmits;
        (size_of::<Self>() + 16 * [demodulated, transmits, alone].map(usize::from).iter().sum::<usize>()) as u64
    }
}

impl SelectedLight {
    /// Returns the bytes per pixel. With `demodulated` a selection holds the part that the diffuse base of z1
    /// contributes, with `reuse` the data of the pixels that could have selected the same light point.
    #[must_use]
    pub fn bytes(demodulated: bool, reuse: bool) -> u64 {
        (size_of::<Self>() + if demodulated { 16 } else { 0 } + if reuse { 48 } else { 0 }) as u64
    }
}

impl Shading {
    /// Returns the bytes per pixel in shaders with these flags.
    #[must_use]
    pub fn bytes(flags: &[Flag]) -> u64 {
        let glossy = flags.contains(&Flag::Glossy);
        let bytes = if glossy { size_of::<Self>() } else { std::mem::offset_of!(Self, specular) };
        let parts = Flag::LAYERS.iter().chain(&[Flag::Transmission]).filter(|flag| flags.contains(flag)).count();
        (bytes + 16 * parts) as u64
    }
}

// Records fill whole rows of tables.
const _: () = {
    assert!(size_of::<Material>() == 16 * rows_of_scene::MATERIAL_ROWS as usize);
    assert!(size_of::<Layers>() == 16 * rows_of_scene::LAYERS_ROWS as usize);
    assert!(size_of::<TextureUse>() == 16 * rows_of_textures::TEXTURE_USE_ROWS as usize);
    assert!(size_of::<LightRecord>() == 16 * rows_of_lights::LIGHT_ROWS as usize);
    assert!(size_of::<LightNode>() == 16 * rows_of_nodes::LIGHT_NODE_ROWS as usize);
};

macro_rules! constants {
    ($($(#[$doc:meta])* mod $group:ident in $file:literal { $($name:ident = $value:expr,)* })*) => {
        $(
            $(#[$doc])*
            #[allow(missing_docs, reason = "the shader's constant of the same name documents it")]
            pub mod $group { $(pub const $name: u32 = $value;)* }
        )*

        /// Returns for each constant the shader file that also declares it, its name and its value.
        #[must_use]
        pub fn constants() -> Vec<(&'static str, &'static str, u32)> {
            vec![$($(($file, stringify!($name), $group::$name),)*)*]
        }
    };
}

constants! {
    /// Bits of [`Material::flags`].
    mod material_flags in "lib/scene/scene" {
        TWO_SIDED = 1,
        EMITS_TWO_SIDED = 2,
        CULLED = 4,
        MASKED = 8,
        NONLINEAR = 16,
        FRESNEL_NONE = 32,
        SHEET = 64,
        TRANSMITS = 128,
        BLENDED = 256,
        BECKMANN_FACETS = 512,
        CLEAR_SHEET = 1024,
        SPECULAR_SURFACE = 2048,
    }

    /// Most light points of an iteration.
    mod light_pool in "shared/light/light_reservoirs" {
        MOST_LIGHT_POINTS = 256,
    }

    /// Rows of records in tables.
    mod rows_of_scene in "lib/scene/scene" {
        MATERIAL_ROWS = 8,
        LAYERS_ROWS = 5,
    }

    /// As [`rows_of_scene`].
    mod rows_of_textures in "lib/surface/texture" {
        TEXTURE_USE_ROWS = 4,
    }

    /// As [`rows_of_scene`].
    mod rows_of_lights in "lib/lights/light" {
        LIGHT_ROWS = 5,
    }

    /// As [`rows_of_scene`].
    mod rows_of_nodes in "lib/lights/light_tree" {
        LIGHT_NODE_ROWS = 2,
    }

    /// Values of [`Material::model`].
    mod bsdf_model in "lib/scene/scene" {
        DIFFUSE = 0,
        METALLIC_ROUGHNESS = 1,
        CONDUCTOR = 2,
        PLASTIC = 3,
        DIELECTRIC = 4,
        MIX = 5,
    }

    /// Cells along a side of the table of a sheen's albedo.
    mod sheen_size in "lib/surface/sheen" {
        SHEEN_SIDE = 32,
    }

    /// Sizes of the table of rough coats.
    mod coat_size in "lib/surface/rough_coat" {
        COAT_COLUMNS = 64,
        COAT_STRIDE = 68,
        COAT_ROWS = 16,
    }

    /// An index that refers to nothing.
    mod index in "lib/scene/scene" {
        NONE = u32::MAX,
    }

    /// Bits of [`TextureUse::flags`] beside the wrap modes.
    mod texture_flags in "lib/surface/texture" {
        LINEAR = 16,
        SRGB = 32,
        SECOND_UV = 64,
    }

    /// Bits of [`TextureUse::purposes`]: scalars, whose channels are two bits each of [`TextureUse::channels`], then
    /// colours and vectors.
    mod texture_purpose in "lib/surface/texture" {
        OF_ROUGHNESS = 1,
        OF_METALLIC = 2,
        OF_SPECULAR_FACTOR = 4,
        OF_TRANSMISSION = 8,
        OF_COAT = 16,
        OF_COAT_ROUGHNESS = 32,
        OF_SHEEN_ROUGHNESS = 64,
        OF_FILM = 128,
        OF_FILM_THICKNESS = 256,
        OF_OPACITY = 512,
        OF_DIFFUSE_TRANSMISSION = 1024,
        OF_BASE = 2048,
        OF_EMISSION = 4096,
        OF_SPECULAR = 8192,
        OF_SHEEN = 16384,
        OF_NORMAL = 32768,
        OF_COAT_NORMAL = 65536,
        OF_ANISOTROPY = 131072,
        OF_DIFFUSE_TRANSMISSION_COLOR = 262144,
    }

    /// Values of [`View::kind`]. Views of kind `EMPTY` have no triangles.
    mod view_kind in "lib/views/view" {
        PERSPECTIVE = 0,
        PARALLEL = 1,
        EMPTY = 2,
    }

    /// Values of [`LightRecord::kind`].
    mod light_kind in "lib/lights/light" {
        POINT = 0,
        SPOT = 1,
        DIRECTIONAL = 2,
        AREA = 4,
        SKY = 5,
    }

    /// Bits of [`LightNode::child`].
    mod light_node in "lib/lights/light_tree" {
        LEAF = 1 << 31,
        MIRRORED = 1 << 30,
        LINK = (1 << 30) - 1,
    }

    /// Cells along a side of the table of the reflective shadow map.
    mod rsm_size in "lib/lights/rsm" {
        RSM_SIDE = 32,
    }

    /// Cells of directions and of places of the sky's guide, along a side.
    mod guide_size in "lib/lights/sky_guide" {
        GUIDE_DIRECTIONS = 32,
        GUIDE_PLACES = 16,
    }

    /// Cells of the scene's box along an axis, and directions of each along a side.
    mod local_sky_size in "lib/lights/local_sky" {
        LOCAL_CELLS = 12,
        LOCAL_DIRECTIONS = 16,
    }

    /// Values of [`FoundLine::vertex`].
    mod line_end in "shared/light/sky_guide" {
        AT_Z1 = 0,
        AT_LATER = 1,
    }

    /// Cells of the table of bundle directions.
    mod bundle_size in "lib/views/bundle" {
        BUNDLE_ROWS = 128,
        BUNDLE_COLUMNS = 256,
    }

    /// Pixels along a side of a tile that may converge.
    mod tile in "lib/pixels/converged" {
        TILE_SIDE = 16,
    }

    /// Layers that a region writes: light that bypasses the filter, and light that does not.
    mod layer in "shared/film/accumulate" {
        CLEAR = 1,
        INDIRECT = 2,
    }

    /// Values of [`Refinement::kind`] beside 0, no displacement.
    mod height_kind in "lib/scene/refinement" {
        HEIGHT_OF_MAP = 1,
        HEIGHT_OF_NOISE = 2,
        HEIGHT_OF_WAVES = 3,
    }

    /// Classes of pixels that dispatches render together, at most.
    mod classes in "lib/scene/frame" {
        MOST_TOGETHER = 16,
    }

    /// Light points of these, at most.
    mod light_points in "shared/paths/connect" {
        MOST_LIGHT_POINTS = 256,
    }

    /// [`Paths::only_s`] if all strategies count.
    mod strategy in "lib/paths/paths" {
        ANY = u32::MAX,
    }

    /// Groups in which the pixel rows of a workgroup of pass extend are interleaved.
    mod extend in "shared/paths/extend" {
        SWIZZLE = 8,
    }
}
