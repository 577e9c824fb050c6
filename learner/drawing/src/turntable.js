// bodies: v corners [mm], f faces, s spheres [mm]; id: of the figure.
const figure = document.getElementById(id), canvas = figure.querySelector("canvas");
const context = canvas.getContext("2d"), list = figure.querySelector("select");
const [withSurfaces, withSpheres] = figure.querySelectorAll("input");
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b79f00", "#56b4e9", "#7a5195", "#8c564b"];
const colour = (i) => COLOURS[i % COLOURS.length];
let azimuth = -0.9, elevation = 0.35, zoom = 1, shift = [0, 0];

function drawn() {
  return bodies.map((body, i) => i).filter((i) => list.selectedIndex < 1 || i === list.selectedIndex - 1);
}

// The middle and the radius of what is drawn.
function extent(which) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const add = (p, r) => p.forEach((x, k) => { low[k] = Math.min(low[k], x - r); high[k] = Math.max(high[k], x + r); });
  for (const i of which) {
    const { v, s } = bodies[i];
    for (let k = 0; k < v.length; k += 3) add([v[k], v[k + 1], v[k + 2]], 0);
    for (let k = 0; k < s.length; k += 4) add([s[k], s[k + 1], s[k + 2]], s[k + 3]);
  }
  const middle = low.map((x, k) => 0.5 * (x + high[k]));
  return [middle, 0.5 * Math.hypot(...low.map((x, k) => high[k] - x))];
}

function draw() {
  const which = drawn(), [middle, radius] = extent(which);
  const scale = zoom * 0.6 * Math.min(canvas.width, canvas.height) / (radius || 1);
  const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
  // To the right, up, and towards the eye; z is up.
  const see = (x, y, z) => {
    x -= middle[0]; y -= middle[1]; z -= middle[2];
    const across = -sa * x + ca * y, along = ca * x + sa * y;
    return [canvas.width / 2 + shift[0] + scale * across,
      canvas.height / 2 + shift[1] - scale * (ce * z - se * along), ce * along + se * z];
  };
  context.fillStyle = "white";
  context.fillRect(0, 0, canvas.width, canvas.height);
  const faces = [];
  if (withSurfaces.checked) {
    for (const i of which) {
      const { v, f } = bodies[i], seen = [];
      for (let k = 0; k < v.length; k += 3) seen.push(see(v[k], v[k + 1], v[k + 2]));
      for (let k = 0; k < f.length; k += 3) {
        const [a, b, c] = [seen[f[k]], seen[f[k + 1]], seen[f[k + 2]]];
        // The normal, in pixels: the steeper it is seen, the darker.
        const u = [b[0] - a[0], b[1] - a[1], scale * (b[2] - a[2])], w = [c[0] - a[0], c[1] - a[1], scale * (c[2] - a[2])];
        const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
        const light = Math.abs(0.3 * n[0] - 0.45 * n[1] + 0.84 * n[2]) / (Math.hypot(...n) || 1);
        faces.push([a[2] + b[2] + c[2], a, b, c, Math.round(95 + 140 * light)]);
      }
    }
    faces.sort((a, b) => a[0] - b[0]);
    context.lineWidth = 1;
    for (const [, a, b, c, grey] of faces) {
      context.fillStyle = context.strokeStyle = `rgb(${grey},${grey},${Math.min(255, grey + 6)})`;
      context.beginPath();
      context.moveTo(a[0], a[1]); context.lineTo(b[0], b[1]); context.lineTo(c[0], c[1]);
      context.closePath(); context.fill(); context.stroke();
    }
  }
  if (withSpheres.checked) {
    const spheres = [];
    for (const i of which) {
      const { s } = bodies[i];
      for (let k = 0; k < s.length; k += 4) spheres.push([see(s[k], s[k + 1], s[k + 2]), scale * s[k + 3], colour(i)]);
    }
    spheres.sort((a, b) => a[0][2] - b[0][2]);
    context.lineWidth = 1.5;
    for (const [at, r, of] of spheres) {
      context.beginPath();
      context.arc(at[0], at[1], r, 0, 2 * Math.PI);
      context.globalAlpha = 0.1; context.fillStyle = of; context.fill();
      context.globalAlpha = 0.75; context.strokeStyle = of; context.stroke();
    }
    context.globalAlpha = 1;
  }
  // The axes, in a corner.
  context.lineWidth = 3; context.font = "24px sans-serif";
  const origin = see(...middle);
  [["x", "#c2291f"], ["y", "#1b7a3a"], ["z", "#1f4fc2"]].forEach(([name, ink], k) => {
    const p = [...middle]; p[k] += 70 / scale;
    const end = see(...p), x = 90 + end[0] - origin[0], y = canvas.height - 90 + end[1] - origin[1];
    context.strokeStyle = context.fillStyle = ink;
    context.beginPath(); context.moveTo(90, canvas.height - 90); context.lineTo(x, y); context.stroke();
    context.fillText(name, x + 6, y);
  });
}

let from = null;
canvas.addEventListener("pointerdown", (event) => { from = event; canvas.setPointerCapture(event.pointerId); });
canvas.addEventListener("pointerup", () => { from = null; });
canvas.addEventListener("pointermove", (event) => {
  if (!from) return;
  const [dx, dy] = [event.clientX - from.clientX, event.clientY - from.clientY];
  if (event.shiftKey) {
    const pixels = canvas.width / canvas.clientWidth;
    shift = [shift[0] + dx * pixels, shift[1] + dy * pixels];
  } else {
    azimuth -= 0.008 * dx;
    elevation = Math.max(-1.57, Math.min(1.57, elevation + 0.008 * dy));
  }
  from = event;
  requestAnimationFrame(draw);
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom *= Math.exp(-0.001 * event.deltaY);
  requestAnimationFrame(draw);
}, { passive: false });
for (const input of [list, withSurfaces, withSpheres]) {
  input.addEventListener("change", () => { shift = [0, 0]; draw(); });
}
draw();
