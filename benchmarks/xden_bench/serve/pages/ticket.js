// Looks how it stands with the file, until nothing changes any more.
const status = document.getElementById("status");
const PERIOD_MS = 700;

async function look() {
  if (status.dataset.waiting === "no") return;
  try {
    const answer = await fetch(`${location.pathname}?part=status`);
    if (answer.ok) {
      const page = new DOMParser().parseFromString(await answer.text(), "text/html");
      const now = page.getElementById("status");
      status.replaceChildren(...now.childNodes);
      Object.assign(status.dataset, now.dataset);
    }
  } finally {
    setTimeout(look, PERIOD_MS);
  }
}

setTimeout(look, PERIOD_MS);
