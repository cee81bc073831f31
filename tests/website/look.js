// What is wrong with the page as it is shown now: a list of sentences.
(() => {
  const found = [];

  const visible = (element) =>
    element.checkVisibility({
      opacityProperty: true,
      visibilityProperty: true,
      contentVisibilityAuto: true,
    });

  const say = (element) => {
    const text = (element.textContent || "").trim().slice(0, 40);
    return `${element.tagName.toLowerCase()}.${element.className || ""} "${text}"`;
  };

  if (!document.body.innerText.trim()) found.push("no text");

  // pictures: those that load when they come into view are asked for by the caller
  for (const image of document.images) {
    if (image.complete && image.naturalWidth === 0)
      found.push(`no picture: ${image.getAttribute("src")}`);
    if (!image.hasAttribute("alt") || !image.alt.trim())
      found.push(`no text for the picture ${image.getAttribute("src")}`);
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
    for (const element of article.querySelectorAll(
      "p, li, table, pre, img, math, h1, h2, h3, dt, dd",
    )) {
      if (visible(element) && element.getBoundingClientRect().right > edge && !scrolls(element))
        found.push(`leaves the window: ${say(element)}`);
    }
  }
  return [...new Set(found)].slice(0, 20);
})();
