use tprmp_cover::*;
fn main(){ for f in std::env::args().skip(1) { let t=std::time::Instant::now(); let c=cover(std::path::Path::new(&f),None,&Packages::default(),&Options{spheres_max: std::env::var("K").ok().and_then(|k|k.parse().ok()).unwrap_or(64),..Options::default()});
 match c { Err(e)=>println!("{f}: {e}"), Ok(c)=>{ println!("{f}: {} spheres {:.1} mm {:.2}s", c.sphere_count(), c.protrusion_m*1e3, t.elapsed().as_secs_f64()); for l in &c.links { println!("   {} tri {} sph {} {:.1} mm {:?}", l.link,l.triangles.len(),l.spheres.len(),l.protrusion_m*1e3,l.missing); } } } } }
