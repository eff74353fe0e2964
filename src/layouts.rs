//! Structs that shaders read, byte for byte. `tests/layouts.rs` compares names, offsets and sizes with the linked shaders.

use bytemuck::{Pod, Zeroable};

macro_rules! layouts {
    ($($(#[$doc:meta])* struct $name:ident in $shader:literal { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
            #[allow(missing_docs, reason = "the shader's struct of the same name documents its fields")]
            pub struct $name { $($(#[$field_doc])* pub $field: $type,)* }
        )*

        /// For each struct: its name, a shader module that holds it, its size and its fields with their offsets.
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
    /// A vertex beside its position; the last two fields only where there are textures.
    struct Attributes in "connect" {
        normal: [f32; 3],
        color: u32,
        tangent: [f32; 4],
        uv: [f32; 4],
    }

    /// Corners and material of a triangle.
    struct Triangle in "connect" {
        vertices: [u32; 3],
        material: u32,
    }

    /// A vertex before it is posed.
    struct RestVertex in "deform" {
        position: [f32; 3],
        instance: u32,
        normal: [f32; 3],
        joints_begin: u32,
        tangent: [f32; 4],
        joints_end: u32,
        morph: u32,
        pad: [u32; 2],
    }

    /// Where a posed vertex comes from.
    struct Origin in "deform" {
        corners: [u32; 3],
        source: u32,
    }

    /// An instance in its pose.
    struct PosedInstance in "deform" {
        world_from_local: [[f32; 4]; 3],
        matrices: u32,
        weights: u32,
        targets: u32,
        vertices: u32,
    }

    /// A joint that a vertex follows.
    struct Joint in "deform" {
        index: u32,
        weight: f32,
    }

    /// What a morph target adds to a vertex.
    struct MorphOffset in "deform" {
        position: [f32; 4],
        normal: [f32; 4],
        tangent: [f32; 4],
    }

    /// Where a control vertex of a refined mesh comes from.
    struct ControlOrigin in "controls" {
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
    struct Control in "controls" {
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

    /// A vertex that tessellation makes.
    struct Blend in "tessellate" {
        corners: [u32; 3],
        y: f32,
        heights: [u32; 3],
        z: f32,
    }

    /// Which vertices tessellation makes.
    struct NewVertices in "tessellate" {
        first: u32,
        count: u32,
        pad0: u32,
        pad1: u32,
    }

    /// How a surface is refined.
    struct Refinement in "tessellate" {
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
    struct Wave in "tessellate" {
        cycles: [f32; 3],
        amplitude: f32,
        phase: f32,
        pad0: f32,
        pad1: f32,
        pad2: f32,
    }

    /// A material.
    struct Material in "connect" {
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
        normal_scale: f32,
        mask_value: f32,
        mask_cutoff: f32,
        base_texture: u32,
        roughness_texture: u32,
        metallic_texture: u32,
        specular_texture: u32,
        specular_factor_texture: u32,
        emission_texture: u32,
        normal_texture: u32,
        mask_texture: u32,
        transmission_texture: u32,
        absorption: [f32; 3],
        transmission: f32,
    }

    /// One use of a texture by a material.
    struct TextureUse in "connect" {
        row_u: [f32; 3],
        layer: u32,
        row_v: [f32; 3],
        flags: u32,
        origin: [f32; 2],
        size: [f32; 2],
    }

    /// A view, or where one will be.
    struct View in "view_setup" {
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

    /// What one iteration shares.
    struct Frame in "connect" {
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
    }

    /// A strategy's constants.
    struct Strategy in "connect" {
        allowed: [f32; 4],
        s: u32,
        j: u32,
        clamp_distance: f32,
        clear: u32,
    }

    /// What a view wanted and what it had.
    struct Demand in "accumulate" {
        items: u32,
        nodes: u32,
        item_room: u32,
        node_room: u32,
    }

    /// A question to a view.
    struct Query in "queries" {
        position: [f32; 3],
        triangle: u32,
    }

    /// What the passes over paths share.
    struct Paths in "eye_paths" {
        seed: u32,
        number: u32,
        first: u32,
        count: u32,
        bounces: u32,
        lens_radius: f32,
        focus: f32,
        only_s: u32,
        only_t: u32,
        unweighted: u32,
        splat_scale: f32,
        tree_lights: u32,
        tree_share: f32,
        biased_reuse: u32,
        memory: f32,
    }

    /// What shines, as a whole.
    struct Lighting in "eye_paths" {
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

    /// A light of the table that subpaths choose from.
    struct LightRecord in "eye_paths" {
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

    /// A node of the tree that lights are chosen by.
    struct LightNode in "eye_paths" {
        center: [f32; 3],
        radius2: f32,
        strength: f32,
        child: u32,
        axis: u32,
        cosines: u32,
    }

    /// A vertex of a light subpath of the path methods; the host only needs its size.
    struct PathVertex in "light_paths" {
        throughput: [f32; 3],
        triangle: u32,
        wi: [f32; 3],
        p: f32,
        barycentric: [f32; 2],
        d: f32,
        c: f32,
    }

    /// What a pixel's path meets first; the host only needs its size.
    struct FirstHit in "reservoirs" {
        wo: [f32; 3],
        triangle: u32,
        barycentric: [f32; 2],
        distance: f32,
        pad: f32,
    }

    /// A light sample that stands for many; the host only needs its size.
    struct Reservoir in "reservoirs" {
        light: u32,
        confidence: f32,
        u: [f32; 2],
        weight: f32,
        aim: f32,
        pad0: f32,
        pad1: f32,
    }

    /// A question to samplers.
    struct DrawQuestion in "draws" {
        given: [f32; 3],
        triangle: u32,
        w: [f32; 3],
        kind: u32,
    }

    /// What a sampler says.
    struct DrawAnswer in "draws" {
        w: [f32; 3],
        pdf_w: f32,
        extra: [f32; 3],
        index: u32,
    }

    /// A question to ray queries.
    struct RayQuestion in "ray_queries" {
        position: [f32; 3],
        own: u32,
        towards: [f32; 3],
        end: u32,
        kind: u32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }

    /// Which light a light point lies on, and where.
    struct LightStart in "light_point" {
        random: [f32; 2],
        light: u32,
        pad: u32,
    }

    /// Where a light subpath starts.
    struct LightPoint in "light_point" {
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

    /// A ray from a light, drawn or asked about.
    struct LightDraw in "light_draws" {
        w: [f32; 3],
        pdf: f32,
        offset: [f32; 3],
        asked: u32,
    }

    /// What the weights of random paths are taken for.
    struct PathWeights in "path_weights" {
        allowed: [f32; 4],
        beta: f32,
        kind: u32,
        pad0: u32,
        pad1: u32,
    }

    /// A vertex of the light subpath; the host only needs its size.
    struct LightVertex in "connect" {
        position: [f32; 3],
        triangle: u32,
        ng: [f32; 3],
        pdf_a: f32,
        throughput: [f32; 3],
        r1: f32,
        wi: [f32; 3],
        here: f32,
        bsdf: [[f32; 4]; 5],
        q0: f32,
        pad0: f32,
        pad1: f32,
        pad2: f32,
    }

    /// A vertex of an eye subpath; the host only needs its size.
    struct EyeVertex in "connect" {
        position: [f32; 3],
        triangle: u32,
        throughput: [f32; 3],
        made: f32,
        wo: [f32; 3],
        here: f32,
        back: f32,
        previous: f32,
        barycentric: [f32; 2],
    }

    /// What a pixel chose from a pool of light points.
    struct Choice in "light_pool" {
        value: [f32; 3],
        light_point: u32,
    }

    /// What a pixel saw in an iteration and kept of its light points; the host only needs its size.
    struct PoolSite in "light_reuse" {
        wo: [f32; 3],
        triangle: u32,
        barycentric: [f32; 2],
        light_point: u32,
        weight: f32,
    }

    /// How what the last iteration kept is used.
    struct Reuse in "light_reuse" {
        has_past: u32,
        biased: u32,
    }

    /// What filters need to know of what a pixel shows.
    struct Guide in "temporal" {
        position: [f32; 3],
        triangle: u32,
        normal: [f32; 3],
        pad: u32,
        reflectance: [u32; 2],
        pad2: [u32; 2],
    }

    /// What frames of a moving picture share.
    struct Live in "temporal" {
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

    /// What is kept of a surface per pixel; the last two fields only where anything is glossy. The host only needs its size.
    struct Shading in "connect" {
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
    /// Bytes per vertex.
    #[must_use]
    pub fn bytes(textured: bool) -> usize {
        if textured { size_of::<Self>() } else { std::mem::offset_of!(Self, tangent) }
    }
}

impl EyeVertex {
    /// Bytes per pixel; `shared`: with the share that the first vertex's diffuse base has.
    #[must_use]
    pub fn bytes(shared: bool) -> u64 {
        (size_of::<Self>() + if shared { 16 } else { 0 }) as u64
    }
}

impl Choice {
    /// Bytes per pixel; `shared`: with the share that the first vertex's diffuse base has; `reuse`: with who could have chosen the same.
    #[must_use]
    pub fn bytes(shared: bool, reuse: bool) -> u64 {
        (size_of::<Self>() + if shared { 16 } else { 0 } + if reuse { 48 } else { 0 }) as u64
    }
}

impl Shading {
    /// Bytes per pixel.
    #[must_use]
    pub fn bytes(glossy: bool) -> u64 {
        (if glossy { size_of::<Self>() } else { std::mem::offset_of!(Self, specular) }) as u64
    }
}

impl View {
    /// Nothing is in it and it hides everything.
    pub const EMPTY: u32 = 2;
    /// All directions from a point.
    pub const PERSPECTIVE: u32 = 0;
    /// One direction through the scene.
    pub const PARALLEL: u32 = 1;
}
