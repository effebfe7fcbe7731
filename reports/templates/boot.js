// Runs the script of the scene, which the page holds deflated: a third of its size.
(async () => {
  if (!window.DecompressionStream) {
    const notice = document.getElementById("scene-fallback");
    notice.hidden = false;
    notice.textContent = "The replay in 3D needs a browser of 2023 or later.";
    return;
  }
  const code = document.getElementById("scene-code").textContent;
  const packed = Uint8Array.from(atob(code), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
})();
