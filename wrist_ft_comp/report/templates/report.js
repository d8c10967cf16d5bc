// Hover shows time and value of a picture, a click copies --exclude; without this all stays readable.
const clock = (seconds) => {
  const [h, m, s] = [seconds / 3600, (seconds / 60) % 60, seconds % 60].map(Math.floor);
  return `${h}:${String(m).padStart(2, '0')}:${String(s).padStart(2, '0')}`;
};
for (const picture of document.querySelectorAll('svg[data-plot]')) {
  const plot = JSON.parse(picture.dataset.plot);
  const said = picture.parentElement.querySelector('output');
  const nearest = (event) => {
    const box = picture.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * picture.viewBox.baseVal.width;
    const hour = plot.from + ((x - plot.left) / (plot.right - plot.left)) * (plot.to - plot.from);
    const far = plot.hours.map((other) => Math.abs(other - hour));
    return far.indexOf(Math.min(...far));
  };
  picture.addEventListener('pointermove', (event) => {
    const i = nearest(event);
    said.textContent = `${clock(plot.seconds[i])}: ${plot.after[i]} ${plot.unit}`
      + ` (without compensation ${plot.before[i]}); click copies --exclude`;
  });
  picture.addEventListener('click', (event) => {
    const second = Math.round(plot.seconds[nearest(event)]);
    said.textContent = `--exclude ${Math.max(second - 30, 0)}..${second + 30}`;
    getSelection().selectAllChildren(said);
    document.execCommand('copy');
  });
}
addEventListener('beforeprint', () => {
  for (const folded of document.querySelectorAll('details')) folded.open = true;
});
