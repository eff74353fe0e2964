use lightsheaf::*;
fn main() {
    env_logger::init();
    let args: Vec<String> = std::env::args().collect();
    let scene = scene::load(&args[1]).unwrap();
    let mut settings = settings::Settings::default();
    settings.samples = args[3].parse().unwrap();
    if let Ok(s) = std::env::var("SIZE") {
        let (a, b) = s.split_once("x").unwrap();
        settings.width = a.parse().unwrap();
        settings.height = b.parse().unwrap();
    }
    if let Ok(s) = std::env::var("SEED") {
        settings.seed = s.parse().unwrap();
    }
    if let Ok(s) = std::env::var("RES") {
        let r = s.parse().unwrap();
        settings.bundle_resolution = Some(r);
        settings.light_resolution = Some(r);
        settings.vpl_resolution = Some(r);
    }
    if let Ok(s) = std::env::var("FAST") {
        if s == "1" {
            settings.visibility = settings::Visibility::Fast
        }
    }
    if let Ok(s) = std::env::var("BOUNCES") {
        settings.bounces = s.parse().unwrap();
    }
    if let Ok(s) = std::env::var("ST") {
        settings.strategies = clap::ValueEnum::from_str(&s, true).unwrap();
    }
    let gpu = gpu::Gpu::new().unwrap();
    println!("{}", gpu.capabilities.adapter);
    let t = std::time::Instant::now();
    let mut r = renderer::Renderer::new(&gpu, &scene, &settings).unwrap();
    println!("{}\nsetup {:?}", r.plan(), t.elapsed());
    let t = std::time::Instant::now();
    r.render(settings.samples as u64, &mut |_| true).unwrap();
    println!("render {:?} per iteration {:?}", t.elapsed(), t.elapsed() / settings.samples);
    let film = r.film().unwrap();
    film.save(std::path::Path::new(&args[2])).unwrap();
    let s = r.stats();
    println!("nonfinite {} redone {} demands {:?}", s.non_finite, s.redone, s.demands);
    for (k, v) in &s.passes {
        println!("{k:16} {:5} {:9.2} ms/run {:9.1} ms", v.runs, v.gpu_millis / v.runs as f64, v.gpu_millis);
    }
    if args.len() > 4 {
        let reference = film::Film::load(std::path::Path::new(&args[4])).unwrap();
        println!("{:?}", metrics::compare(&film, &reference).unwrap());
    }
}
