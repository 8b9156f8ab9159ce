// Before the first paint: the theme that was chosen on this computer; none: the system's.
try {
  const theme = localStorage.getItem("umo-theme");
  if (theme) document.documentElement.dataset.theme = theme;
} catch { /* no storage: the system's */ }
