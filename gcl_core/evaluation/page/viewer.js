// Two clouds on a canvas: drag to turn, wheel to zoom, buttons for where the source lies.
'use strict';
const STEP = 0.02;  // metres of one unit of the packed coordinates, see cases.py

function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return Float32Array.from(new Int16Array(bytes.buffer), v => v * STEP);
}

function moved(points, T) {
  const out = new Float32Array(points.length);
  for (let i = 0; i < points.length; i += 3)
    for (let r = 0; r < 3; r++)
      out[i + r] = T[r][0] * points[i] + T[r][1] * points[i + 1] + T[r][2] * points[i + 2] + T[r][3];
  return out;
}

function show(box) {
  const data = JSON.parse(box.querySelector('script').textContent);
  const canvas = box.querySelector('canvas'), pen = canvas.getContext('2d');
  const target = unpacked(data.target), source = unpacked(data.source);
  const view = {yaw: 0, tilt: 0, scale: canvas.height / 110};
  const middle = data.poses['true transform'].map(row => row[3] / 2);
  let placed = source;

  function cloud(points, color) {
    const cy = Math.cos(view.yaw), sy = Math.sin(view.yaw);
    const ct = Math.cos(view.tilt), st = Math.sin(view.tilt);
    pen.fillStyle = color;
    for (let i = 0; i < points.length; i += 3) {
      const x = points[i] - middle[0], y = points[i + 1] - middle[1], z = points[i + 2] - middle[2];
      const right = cy * x - sy * y, ahead = sy * x + cy * y;
      const u = canvas.width / 2 + view.scale * right;
      const v = canvas.height / 2 - view.scale * (ct * ahead + st * z);
      pen.fillRect(u, v, 1.5, 1.5);
    }
  }

  function draw() {
    pen.fillStyle = '#fff';
    pen.fillRect(0, 0, canvas.width, canvas.height);
    cloud(target, '#1971c2');
    cloud(placed, '#e8590c');
  }

  for (const button of box.querySelectorAll('button'))
    button.addEventListener('click', () => {
      for (const other of box.querySelectorAll('button')) other.ariaPressed = other === button;
      placed = moved(source, data.poses[button.textContent]);
      draw();
    });
  canvas.addEventListener('pointerdown', event => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener('pointermove', event => {
    if (!event.buttons) return;
    view.yaw -= event.movementX * 0.008;
    view.tilt = Math.min(1.57, Math.max(0, view.tilt - event.movementY * 0.008));
    draw();
  });
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    view.scale *= Math.exp(-event.deltaY * 0.001);
    draw();
  }, {passive: false});
  box.querySelector('button').click();
}

const boxes = document.querySelectorAll('.case');
boxes.forEach(show);
document.body.dataset.shown = boxes.length;  // for the test: every view was drawn
