// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// The site's search runs in a worker, which browsers do not start from a file: there a hidden frame does its work.
if (location.protocol === "file:") {
  window.Worker = class {
    constructor(url) {
      this.frame = document.body.appendChild(document.createElement("iframe"));
      this.frame.hidden = true;
      this.inside = this.frame.contentWindow;
      this.inside.postMessage = (data) => setTimeout(() => this.onmessage?.({ data }));
      const script = this.inside.document.createElement("script");
      script.src = url;
      this.started = new Promise((resolve, reject) => Object.assign(script, { onload: resolve, onerror: reject }));
      this.started.catch((event) => this.onerror?.(event));
      this.inside.document.body.append(script);
    }
    postMessage(data) {
      this.started.then(() => this.inside.onmessage({ data }), () => {});
    }
    terminate() {
      this.frame.remove();
    }
  };
}
