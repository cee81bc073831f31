// What is wrong with the page as it is shown now: a list of sentences.
(() => {
  const LEAST = 4.5;
  const found = [];

  const numbers = (text) => (text.match(/[\d.]+/g) || []).map(Number);

  // colours that rgb() does not write (color-mix and the like) go through a canvas
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const colours = new Map();
  const colour = (text) => {
    if (!colours.has(text)) {
      let read = numbers(text);
      if (!text.startsWith("rgb")) {
        canvas.clearRect(0, 0, 1, 1);
        canvas.fillStyle = text;
        canvas.fillRect(0, 0, 1, 1);
        read = [...canvas.getImageData(0, 0, 1, 1).data];
        read[3] /= 255;
      }
      colours.set(text, read.length === 3 ? [...read, 1] : read);
    }
    return colours.get(text);
  };

  const over = (front, back) => front.slice(0, 3).map((x, k) => front[3] * x + (1 - front[3]) * back[k]);

  const backgrounds = new Map();
  const background = (element) => {
    if (element === null) return [255, 255, 255];
    if (!backgrounds.has(element)) {
      const own = colour(getComputedStyle(element).backgroundColor);
      backgrounds.set(element, own[3] === 1 ? own.slice(0, 3) : over(own, background(element.parentElement)));
    }
    return backgrounds.get(element);
  };

  const luminance = (rgb) => {
    const [r, g, b] = rgb.map((x) => {
      const share = x / 255;
      return share <= 0.03928 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };

  const contrast = (element) => {
    const back = background(element);
    const front = over(colour(getComputedStyle(element).color), back);
    const [light, dark] = [luminance(front), luminance(back)].sort((a, b) => b - a);
    return (light + 0.05) / (dark + 0.05);
  };

  const visible = (element) =>
    element.checkVisibility({ opacityProperty: true, visibilityProperty: true, contentVisibilityAuto: true });

  const say = (element) => `${element.tagName.toLowerCase()}.${element.className || ""} "${(element.textContent || "").trim().slice(0, 40)}"`;

  // text
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const judged = new Set();
  let texts = 0;
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || judged.has(element)) continue;
    judged.add(element);
    if (!visible(element) || element.closest("script, style, noscript, template, svg")) continue;
    texts += 1;
    const ratio = contrast(element);
    if (ratio < LEAST) found.push(`contrast ${ratio.toFixed(2)}: ${say(element)}`);
  }
  if (texts === 0) found.push("no text");

  // pictures: those that load when they come into view are asked for by the caller
  for (const image of document.images) {
    if (image.complete && image.naturalWidth === 0) found.push(`no picture: ${image.getAttribute("src")}`);
    if (!image.hasAttribute("alt") || !image.alt.trim()) found.push(`no text for the picture ${image.getAttribute("src")}`);
  }

  // width
  const wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  if (wide > 1) found.push(`the page is ${wide} px wider than its window`);
  const article = document.querySelector("article");
  if (article) {
    const edge = document.documentElement.clientWidth + 1;
    const scrolls = (element) => {
      for (let each = element.parentElement; each && each !== article; each = each.parentElement)
        if (["auto", "scroll", "hidden"].includes(getComputedStyle(each).overflowX)) return true;
      return false;
    };
    for (const element of article.querySelectorAll("p, li, table, pre, img, math, h1, h2, h3, dt, dd")) {
      if (visible(element) && element.getBoundingClientRect().right > edge && !scrolls(element))
        found.push(`leaves the window: ${say(element)}`);
    }
  }
  return [...new Set(found)].slice(0, 20);
})()
