{
  buildViewer();
  buildSheet();
  buildTransport();
  const plots = $("plots"), water = $("water-plot");
  if (plots) DATA.plots.forEach(plot => buildPlot(plot, plots));
  if (water) buildPlot(DATA.attenuation, water);
  setTheme(preference.matches);
  if (DATA.frames.length) show(0);
}
